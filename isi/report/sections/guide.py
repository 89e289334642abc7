"""What the page is about: how an entity is inserted and asked about, and what the words mean."""

from __future__ import annotations

from collections.abc import Iterator

from isi.report.glossary import models, of_the_page
from isi.report.results import Results
from isi.report.section import Content, Section, Words, Written


def contents(results: Results) -> Iterator[Content]:
    """A drawing of what is done, then words."""
    yield Written("guide.html")
    yield Words("What the words mean", of_the_page())
    yield Words("Who is compared: every initializer", models(results), folded=True)


SECTION = Section("guide", "What is done, and what the words mean", contents, opened=True)
