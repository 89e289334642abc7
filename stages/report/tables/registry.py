"""Every table of a page is a function of its results that gives a frame."""

import re
from collections.abc import Callable, Mapping
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from isi.config import Plugins
from isi.errors import InputError, suggestion
from isi.tables.io import atomically, keep_only
from stages.report.tables.forms import files

#: What a function gives: a frame, frames by the part of their names that differs, or None where
#: there are no data.
TableFrames = pd.DataFrame | Mapping[str, pd.DataFrame] | None
TableFunction = Callable[[Any], TableFrames]
F = TypeVar("F", bound=TableFunction)
OfExperiment = Callable[[Any, Any], pd.DataFrame | None]
#: Functions by page, then by name of the table. The ``{}`` of a name stands for several tables.
TABLES: dict[str, Plugins[TableFunction]] = {}


def table(page: str, name: str = "") -> Callable[[F], F]:
    """Register a function as a table of a page, under its own name or another one.

    The name of several tables has a ``{}``, such as ``strong_{}``; their function gives frames by
    what stands in its place. ``InputError`` where another function has the name.
    """

    def register(function: F) -> F:
        functions = TABLES.setdefault(page, Plugins("stages.report.tables"))
        functions.register(name or function.__name__, function)
        return function

    return register


def of_each(kind: str) -> Callable[[OfExperiment], Callable[[Any], pd.DataFrame | None]]:
    """Make a function of results and one experiment a function of results: the rows of every
    experiment of a kind (an attribute of ``Results``) below each other, after a column ``graph``
    with its title.
    """

    def decorate(function: OfExperiment) -> Callable[[Any], pd.DataFrame | None]:
        @wraps(function)
        def of_results(results: Any) -> pd.DataFrame | None:
            frames = list[pd.DataFrame]()
            for experiment in getattr(results, kind):
                frame = function(results, experiment)
                if frame is not None:
                    frame = frame.reset_index(drop=True)
                    frame.insert(0, "graph", experiment.title)
                    frames.append(frame)
            return pd.concat(frames, ignore_index=True) if frames else None

        return of_results

    return decorate


def names_of(page: str) -> list[str]:
    """The names of the tables of a page; ``{}`` in one stands for several tables."""
    return TABLES.setdefault(page, Plugins("stages.report.tables")).names()


def check_name(page: str, name: str, place: str) -> None:
    """``InputError`` at a place unless a page can have a table of a name."""
    names = names_of(page)
    patterns = [re.escape(known).replace(r"\{\}", ".+") for known in names]
    if not any(re.fullmatch(pattern, name) for pattern in patterns):
        expected = f"expected the name of a table, got {name!r}{suggestion(name, names)}"
        raise InputError("", place, expected)


def frames_of(page: str, results: Any) -> dict[str, pd.DataFrame]:
    """All tables of a page, by name; those without rows are left out."""
    frames = dict[str, pd.DataFrame]()
    for name in names_of(page):
        of_function = TABLES[page].get(name)(results)
        if isinstance(of_function, pd.DataFrame):
            frames[name] = of_function
        elif of_function is not None:
            frames |= {name.format(part): frame for part, frame in of_function.items()}
    return {name: frame for name, frame in frames.items() if len(frame)}


def write(page: str, results: Any, folder: Path) -> None:
    """Write the tables of a page into a folder; delete those of before."""
    texts = dict[str, str]()
    for name, frame in frames_of(page, results).items():
        texts |= {f"{name}.{form}": text for form, text in files(frame).items()}
    write_files(folder, texts)


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write files by name into a folder, each atomically; delete those of before."""
    for name, content in contents.items():
        data = content.encode() if isinstance(content, str) else content
        atomically(folder / name, partial(Path.write_bytes, data=data))
    keep_only(folder, [folder / name for name in contents])
