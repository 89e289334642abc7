"""Other words: definitions, bare phrases, and what they are worth to those who use words."""

from __future__ import annotations

from collections.abc import Iterator

from isi.report import varied
from isi.report.results import Results
from isi.report.section import Content, Section, Table
from isi.report.sections.embeddings import about, frame


def contents(results: Results) -> Iterator[Content]:
    """A row for each kind of word vectors and each graph."""
    found = varied.group(results.beyond, "words")
    if not found:
        return
    yield (
        "Those that go by words, with vectors of other words. Those that ship were made by a sentence model: from "
        "definitions, from bare phrases, and from WordNet's definitions, which nobody wrote for this project. GloVe's "
        "are a public set that a package ships, one vector for each word. Any other file can be named "
        "(`words.source`)."
    )
    yield Table(
        "other_words",
        "Other words",
        "Entity half of MRR* (points) where the novel entity is asked about, right after insertion, mean over seeds "
        "and its interval.",
        frame(results, found, about, what="words"),
    )


SECTION = Section("vectors", "Other words", contents)
