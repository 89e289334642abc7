"""The hook of mkdocs.yml: in the site, a link from a page to a file outside of docs/
leads to a page that shows it, and the report is copied as it is.

Pages keep relative links that work on a forge. Here, Markdown outside of docs/ becomes a page, and
so does the text of a script or of settings. Comments, which mark places for ``tools/docs.py``, are
left out. The report keeps its own links, so the site has all of its files in the same places.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
REPORTS = ROOT / "reports"  #: The report, with its tables and figures.
FILES = "files"  #: Folder of the site with the pages of files outside of docs/.
#: Suffixes of files that are shown.
LANGUAGES = {".py": "python", ".yaml": "yaml", ".csv": "csv"}
PARTS = re.compile(
    r"^```.*?^```$|<!--.*?-->|(!?)\[([^\]]*)\]\(([^)#\s:]+)(#[^)\s]+)?\)", re.DOTALL | re.MULTILINE
)
CELL = re.compile(r"^# %%[ ]*(.*)\n", re.MULTILINE)


def linked(text: str, origin: Path) -> list[Path]:
    """The files outside of docs/ to which the text of the file ``origin`` links,
    and which the site shows.
    """
    targets = (origin.parent / part[3] for part in PARTS.finditer(text) if part[3])
    paths = (Path(os.path.normpath(target)) for target in targets)
    return [
        path
        for path in paths
        if path.is_file() and not path.is_relative_to(DOCS) and name_of(path) != "README.md"
    ]


def name_of(path: Path) -> str | None:
    """The name of a file among the site's sources; null if the site does not show it."""
    if path.is_relative_to(DOCS):
        return path.relative_to(DOCS).as_posix()
    if path == ROOT / "README.md":
        return "README.md"
    place = path.relative_to(ROOT).as_posix()
    if path.is_relative_to(REPORTS) and path.suffix != ".md":
        return place
    name = f"{FILES}/{place}"
    return name if path.suffix == ".md" else f"{name}.md" if path.suffix in LANGUAGES else None


def path_of(name: str) -> Path:
    """The file that a source of the site is made of."""
    if not name.startswith(f"{FILES}/"):
        return DOCS / name
    path = ROOT / name.removeprefix(f"{FILES}/")
    return path if path.exists() else path.with_suffix("")


def rewritten(text: str, origin: Path) -> str:
    """The text of the file ``origin`` with links as the site needs them, and without comments."""

    def link(part: re.Match[str]) -> str:
        if part[3] is None:
            return part[0] if part[0].startswith("```") else ""
        path = Path(os.path.normpath(origin.parent / part[3]))
        target = name_of(path) if path.is_file() else None
        if target is None:
            # mkdocs warns of a link that leads nowhere
            return part[2] if path.exists() else part[0]
        here = Path(name_of(origin) or "").parent
        return (
            f"{part[1]}[{part[2]}]({Path(os.path.relpath(target, here)).as_posix()}{part[4] or ''})"
        )

    return PARTS.sub(link, text)


def as_page(path: Path) -> str:
    """A file as Markdown: cells of a script in the percent format, other text as one block."""
    text, language = path.read_text(encoding="utf-8"), LANGUAGES.get(path.suffix, "")
    if not language:
        return text
    title = (
        f"---\nsearch:\n  exclude: {str(path.parent.name != 'examples').lower()}\n---\n\n"
        f"# {path.name}\n"
    )
    if language != "python" or not CELL.search(text):
        return f"{title}\n```{language}\n{text.rstrip()}\n```\n"
    first, *cells = CELL.split(text)
    made = [title, ast.get_docstring(ast.parse(text)) or ""]
    for name, body in [
        ("", first.rpartition('"""')[2]),
        *zip(cells[::2], cells[1::2], strict=True),
    ]:
        if name == "[markdown]":
            made.append(
                "\n".join(
                    line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines()
                )
            )
        elif body.strip():
            made.append(f"**{name}**\n" * bool(name) + f"\n```python\n{body.strip()}\n```")
    return "\n\n".join(made) + "\n"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of files outside of docs/ that pages link to,
    directly or through each other.
    """
    from mkdocs.structure.files import File, InclusionLevel

    waiting = [path_of(file.src_uri) for file in files.documentation_pages()]
    while waiting:
        origin = waiting.pop()
        for path in (
            linked(origin.read_text(encoding="utf-8"), origin) if origin.suffix == ".md" else []
        ):
            name = name_of(path)
            if name is None or files.get_file_from_path(name) is not None:
                continue
            if name.endswith(".md"):
                file = File.generated(
                    config, name, content=as_page(path), inclusion=InclusionLevel.NOT_IN_NAV
                )
                waiting.append(path)
            else:
                file = File.generated(config, name, abs_src_path=str(path))
            files.append(file)
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """The Markdown of a page with links as the site needs them."""
    return rewritten(markdown, path_of(page.file.src_uri))


def on_post_build(config: MkDocsConfig) -> None:
    """Copy the report into the built site, with all that it links to."""
    shutil.copytree(REPORTS, Path(config.site_dir) / REPORTS.name, dirs_exist_ok=True)
