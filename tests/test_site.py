"""The site of the documentation: links to files outside of docs/, scripts as pages,
and a build without a network.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from pkgutil import resolve_name

import pytest

from isi.initializers.api import INITIALIZERS
from tools import docs, site

DOCS = docs.ROOT / "docs"
LOADED = re.compile(r"<(?:script|img|iframe|source)[^>]*\ssrc=\"?([^\s\">]+)|<link([^>]*)>")
WITHOUT_NETWORK = """
import socket, sys
def refuse(*_, **__):
    raise OSError("no network here")
socket.socket.connect = socket.getaddrinfo = refuse
from mkdocs.__main__ import cli
cli()
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; a warning fails the build."""
    for package in ("material", "mkdocstrings"):
        pytest.importorskip(package, reason="make site")
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-c",
        WITHOUT_NETWORK,
        "build",
        "--quiet",
        "--strict",
        "--site-dir",
        str(folder),
    ]
    done = subprocess.run(
        command,
        cwd=docs.ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return folder


def test_pages_of_the_site_load_nothing_from_elsewhere(built: Path) -> None:
    pages = list(built.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        for source, link in LOADED.findall(page.read_text(encoding="utf-8")):
            loaded = source or ("" if "canonical" in link else link)
            assert "//" not in loaded, (page.name, loaded)
            if source and not source.startswith("data:"):
                assert (
                    page.parent / source.partition("?")[0]
                ).exists() or page.name == "404.html", source
    for style in built.rglob("*.css"):
        assert not re.search(
            r"url\(['\"]?(?:https?:)?//|@import", style.read_text(encoding="utf-8")
        ), style.name


def test_the_report_is_in_the_site_as_it_is_with_what_it_links_to(built: Path) -> None:
    for page in ("index.html", "beyond/index.html"):
        copied = built / "reports" / page
        assert copied.read_bytes() == (site.REPORTS / page).read_bytes()
        links = re.findall(r'href="((?:figures|tables|\.\.)[^"#]*)"', copied.read_text("utf-8"))
        assert links
        assert [link for link in links if not (copied.parent / link).exists()] == []


def test_the_site_has_the_signatures_and_the_index_of_its_search(built: Path) -> None:
    shown = re.sub(r"<[^>]+>", "", (built / "api.html").read_text(encoding="utf-8"))
    assert "tolerance" in shown
    assert "loss of the MRR of earlier triples" in shown
    assert "espresso machine" in (built / "search" / "search_index.js").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("link", "expected"),
    [
        ("[a](method.md#models)", "[a](method.md#models)"),
        ("[a](../params.yaml)", "[a](files/params.yaml.md)"),
        ("[a](../SECURITY.md)", "[a](files/SECURITY.md)"),
        ("[a](../README.md)", "[a](README.md)"),
        ("[a](../reports/tables)", "a"),
        ("[a](../reports/index.html#explorer)", "[a](reports/index.html#explorer)"),
        ("![a](../reports/figures/answer.svg)", "![a](reports/figures/answer.svg)"),
        ("[a](../nowhere.py)", "[a](../nowhere.py)"),
        ("[a](https://example.org/b.py)", "[a](https://example.org/b.py)"),
        ("a<!-- value: b | c -->1<!-- end -->", "a1"),
        ("```\n[a](../params.yaml)\n```", "```\n[a](../params.yaml)\n```"),
    ],
)
def test_links_lead_to_pages_of_the_site(link: str, expected: str) -> None:
    assert site.rewritten(link, DOCS / "page.md") == expected


def test_links_of_files_outside_of_docs_lead_to_the_same_pages() -> None:
    assert (
        site.rewritten("[a](../docs/method.md)", docs.ROOT / "examples/README.md")
        == "[a](../../method.md)"
    )
    assert site.rewritten("[a](home.csv)", docs.ROOT / "examples/README.md") == "[a](home.csv.md)"
    for path in (DOCS / "method.md", docs.ROOT / "params.yaml", docs.ROOT / "SECURITY.md"):
        assert site.path_of(site.name_of(path) or "") == path


def test_a_file_without_a_last_line_break_stays_in_its_block(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("a,b\n1,2", encoding="utf-8")
    assert site.as_page(table).endswith("\n```csv\na,b\n1,2\n```\n")


def test_a_script_becomes_prose_and_code(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        '"""What it does."""\n\n# %%\nimport sys\n\n# %% [markdown]\n# A *note*.\n\n# %% Then\n'
        "sys.exit()\n"
    )
    expected = (
        "What it does.\n\n\n```python\nimport sys\n```\n\nA *note*.\n\n**Then**\n\n```python\n"
        "sys.exit()\n```\n"
    )
    assert site.as_page(script).endswith(expected)


@pytest.mark.parametrize(
    "name", re.findall(r"^::: (\S+)$", (DOCS / "api.md").read_text("utf-8"), re.MULTILINE)
)
def test_the_reference_names_what_there_is(name: str) -> None:
    if ".pykeen." in name:
        pytest.importorskip("pykeen")
    assert resolve_name(name).__doc__


def test_the_page_of_initializers_describes_all_with_their_options_and_needs() -> None:
    text = (DOCS / "initializers.md").read_text("utf-8")
    table = text.partition("## All initializers\n")[2].partition("\n## ")[0]
    head, _, *body = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in table.splitlines()
        if line.startswith("|")
    ]
    rows = [dict(zip(head, cells, strict=True)) for cells in body]
    by_name = {row["initializer"].strip("`"): row for row in rows}
    assert len(by_name) == len(rows)
    assert set(by_name) == set(INITIALIZERS.names())
    words = {"words": "words", "insert_triples": "facts", "inverse": "inverse"}
    for name, row in by_name.items():
        registered = INITIALIZERS.get(name, name)
        options = row["options (defaults)"]
        shown = re.findall(r"`(\w+)`[^(]*\(([\d.]+)\)", options)
        numbers = {key: float(value) for key, value in shown}
        words_shown = dict(re.findall(r"`(\w+)` \(`(\w+)`", options))
        defaults = dict(registered.defaults or {})
        texts = {key: value for key, value in defaults.items() if isinstance(value, str)}
        assert words_shown == texts, name
        assert numbers == pytest.approx(
            {key: value for key, value in defaults.items() if key not in texts}
        ), name
        assert row["needs"], name
        assert {need for need, word in words.items() if word in row["needs"]} == set(
            registered.needs
        ), name
        ((function, path),) = re.findall(r"^\[`(\w+)`\]\(\.\./(.*)\)$", row["code"])
        assert f"def {function}(" in (docs.ROOT / path).read_text(encoding="utf-8"), name
