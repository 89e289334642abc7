"""The page as readers see it: opened from a file in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from isi.report import contents, page
from tests.browser import opened
from tests.reports import small_results

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole report of a few invented runs."""
    folder = tmp_path_factory.mktemp("report")
    page.write(folder, small_results(["home", "moved"], studies=True), contents.SECTIONS)
    return folder / "index.html"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_opens_without_an_error_and_asks_for_nothing(chromium: Browser, report: Path, scheme: str) -> None:
    with opened(chromium, report, scheme=scheme) as found:
        assert found.page.title()
        assert found.errors == []
        assert found.requests == []
