"""A real browser that opens pages from files, without a network.

Tests take the fixture ``chromium`` (from ``tests/conftest.py``) and open files with ``opened``.
They are skipped, with the reason, if Playwright (the extra ``browser``) or a Chromium is missing;
the variable ``CHROMIUM`` may hold the path of a Chromium.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
_ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
#: The heights of windows by width, in CSS pixels: a phone and a desktop.
_HEIGHTS = {390: 844, 1280: 900}


@dataclass(frozen=True, eq=False)
class Opened:
    """A page in a window, with the errors and requests since it was opened."""

    page: Page
    #: errors and warnings in the console, and uncaught errors
    errors: list[str] = field(default_factory=list)
    #: requested addresses other than the page's own
    requests: list[str] = field(default_factory=list)

    @property
    def overflow(self) -> int:
        """Width of the page minus width of its window, in CSS pixels; 0 if the page fits."""
        return int(
            self.page.evaluate(
                "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            )
        )


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """A headless Chromium for the tests of a module;
    no other asyncio loop may run until it is closed.
    """
    api = pytest.importorskip("playwright.sync_api", reason="the extra `browser` is not installed")
    found = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        pytest.skip(
            f"no Chromium: none of {', '.join(_NAMES)} is on the path, and CHROMIUM names none"
        )
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=list(_ARGUMENTS))
        yield browser
        browser.close()


@contextmanager
def opened(
    browser: Browser,
    path: Path,
    width: int = 1280,
    scheme: str = "light",
    script: bool = True,
    fragment: str = "",
) -> Iterator[Opened]:
    """Open a file in a new window, and close the window in the end.

    Args:
        width: width of the window, in CSS pixels.
        scheme: preferred colour scheme, ``light`` or ``dark``.
        script: whether JavaScript runs.
        fragment: fragment of the address, without ``#``.
    """
    window = browser.new_context(
        viewport={"width": width, "height": _HEIGHTS.get(width, 900)},
        color_scheme=scheme,  # type: ignore[arg-type]
        java_script_enabled=script,
        reduced_motion="reduce",
    )
    found, address = Opened(window.new_page()), path.resolve().as_uri()
    found.page.on(
        "console",
        lambda message: (
            found.errors.append(message.text) if message.type in ("error", "warning") else None
        ),
    )
    found.page.on("pageerror", lambda error: found.errors.append(str(error)))
    found.page.on(
        "request",
        lambda request: (
            found.requests.append(request.url) if request.url.split("#")[0] != address else None
        ),
    )
    try:
        found.page.goto(f"{address}#{fragment}" if fragment else address)
        yield found
    finally:
        window.close()
