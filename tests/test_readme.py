"""The README and the pages of docs/ show what was made, and nothing else; their links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tools import docs

PAGES = [*docs.pages(), *(docs.ROOT / name for name in ("CONTRIBUTING.md", "CHANGELOG.md"))]
LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@each_page
def test_what_pages_show_is_what_was_made(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert docs.filled(text) == text, "make readme"
    assert len(re.findall("<!-- (?:table|value):", text)) == len(docs.PLACE.findall(text)), "a place without an end"
    assert not re.search("^ {0,3}<!-- value", text, re.MULTILINE), "it would end the paragraph"


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    for path, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        if path.startswith("https://"):
            continue
        target = page.parent / path if path else page
        assert target.exists(), path
        if anchor:
            assert anchor in {slug(heading) for heading in HEADING.findall(target.read_text(encoding="utf-8"))}, anchor


def slug(heading: str) -> str:
    """What a heading is linked by, as forges make it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def test_what_the_method_says_of_rates_and_batches_is_in_its_tables() -> None:
    training, tuning = (
        {rate: float(docs.value(["docs/benchmarks/rates", row, str(rate)])) for rate in rates}
        for row, rates in (("training", (0.1, 0.2, 0.4)), ("fine-tuning", (0.01, 0.02, 0.04, 0.08, 0.16)))
    )
    assert max(training.values()) - min(training.values()) <= 1
    assert min(rate for rate in tuning if tuning[rate] >= max(tuning.values()) - 0.5) == 0.04
    assert docs.value(["params", "finetuning.learning_rate"]) == "0.04"
    assert docs.value(["params", "training.learning_rate"]) == "0.1"
    for row in ("training", "fine-tuning"):
        small, large = (float(docs.value(["docs/benchmarks/batch_sizes", row, size])) for size in ("512", "2,048"))
        assert 0 <= round(small - large, 1) <= 0.5
