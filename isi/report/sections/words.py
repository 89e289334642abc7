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
    """Triples whose tail is named in the definition of their head, each once: what definitions could leak.

    Args:
        graphs: ``tables.ENTITIES`` and ``tables.TRIPLES`` of each experiment.
        definitions: by phrase.
        used: whether they are behind the word vectors.
    """
    parts = []
    for entities, triples in graphs:
        phrase = dict(zip(entities["entity"], entities["phrase"], strict=True))
        said, named = triples["head"].map(phrase).map(definitions), triples["tail"].map(phrase)
        parts.append(triples[_COLUMNS].assign(said=said, named=named))
    every = pd.concat(parts).drop_duplicates(["source", "head", "relation", "tail"])
    defined = every.dropna(subset=["said"])
    given_away = [names(said, tail) for said, tail in zip(defined["said"], defined["named"], strict=True)]
    frame = defined.loc[given_away, [*_COLUMNS, "said"]].reset_index(drop=True)
    return Table(
        "definition_leaks",
        "What definitions could leak",
        f"{len(frame)} of {len(every)} unique triples of all sources have a tail that is named in the definition "
        "of their head, in the words themselves or with the first in a regular inflection. These definitions "
        f"{'are' if used else 'are not'} behind the word vectors of this run. What a phrase itself says (a desk lamp "
        "is of a desk) is not counted.",
        frame.rename(columns={"said": "definition of the head"}),
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
