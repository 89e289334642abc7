"""What the word vectors could leak: triples that a definition gives away."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

import pandas as pd

from isi.report.results import Results
from isi.report.section import Content, Section, Table

_COLUMNS = ["source", "head", "relation", "tail", "count"]


def contents(results: Results) -> Iterator[Content]:
    """What is compared, and what it gives away."""
    definitions = dict(zip(results.definitions["phrase"], results.definitions["definition"], strict=True))
    graphs = [(one.entities, one.triples) for one in results.experiments.values()]
    how = results.params.words
    yield (
        "ES and ERS compare sentences (“phrase: definition”) when `words.text` is `definition`; a definition may name "
        "what the robot is asked."
    )
    yield leaks(graphs, definitions, used=how.source == "shipped" and how.text == "definition")


def leaks(graphs: Iterable[tuple[pd.DataFrame, pd.DataFrame]], definitions: Mapping[str, str], used: bool) -> Table:
    """Triples of which the definition of one end names the other: what definitions could leak.

    Args:
        graphs: ``tables.ENTITIES`` and ``tables.TRIPLES`` of each experiment; triples that several have count once.
        definitions: by phrase.
        used: whether they are behind the word vectors.
    """
    parts = []
    for entities, triples in graphs:
        phrase = dict(zip(entities["entity"], entities["phrase"], strict=True))
        for own, other in (("head", "tail"), ("tail", "head")):
            said, named = triples[own].map(phrase).map(definitions), triples[other].map(phrase)
            parts.append(triples[_COLUMNS].assign(defined=own, said=said, named=named))
    every = pd.concat(parts).drop_duplicates(["source", "head", "relation", "tail", "defined"])
    told = every.dropna(subset=["said"])
    given_away = [names(said, other) for said, other in zip(told["said"], told["named"], strict=True)]
    frame = told.loc[given_away, [*_COLUMNS, "defined", "said"]].reset_index(drop=True)
    numbers = frame["defined"].value_counts()
    return Table(
        "definition_leaks",
        "What definitions could leak",
        f"Of {len(every) // 2} unique triples of all sources, {numbers.get('head', 0)} have a tail that is named in "
        f"the definition of their head, and {numbers.get('tail', 0)} a head that is named in that of their tail, in "
        "the words themselves or with the first in a regular inflection. These definitions "
        f"{'are' if used else 'are not'} behind the word vectors of this run. What a phrase itself says (a desk lamp "
        "is of a desk) is not counted.",
        frame.rename(columns={"defined": "defined end", "said": "its definition"}),
        folded=True,
    )


def names(text: str, phrase: str) -> bool:
    """Whether a text names a phrase, as it stands or with its first word in a regular inflection."""
    first, *rest = phrase.split()
    stem, double = re.escape(first.removesuffix("e")), re.escape(first[-1])
    inflected = rf"{stem}(?:e|s|es|d|ed|en|n|ing|{double}(?:ed|ing))?"
    pattern = r"\s+".join([rf"(?:{inflected}|{re.escape(first)})", *map(re.escape, rest)])
    return re.search(rf"\b{pattern}\b", text) is not None


SECTION = Section("words", "What the word vectors could leak", contents)
