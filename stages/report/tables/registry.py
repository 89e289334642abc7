"""Every table is one function that gives its frame; its name is that of the file."""

from collections.abc import Callable, Mapping
from functools import partial, wraps
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, TypeVar

import pandas as pd

from isi.tables.io import atomically, keep_only
from stages.report.tables.forms import files

#: A function from results to a frame, to frames by name, or to None where there are no data.
Frames = Mapping[str, pd.DataFrame]
Made = pd.DataFrame | Frames | None
F = TypeVar("F", bound=Callable[[Any], Made])
OfExperiment = Callable[[Any, Any], pd.DataFrame | None]
#: Functions by page, then by name of the table.
TABLES: dict[str, dict[str, Callable[[Any], Made]]] = {}


def table(page: str) -> Callable[[F], F]:
    """Register a function as the table of its name on a page."""

    def register(function: F) -> F:
        TABLES.setdefault(page, {})[function.__name__] = function
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


def frames_of(page: str, results: Any) -> dict[str, pd.DataFrame]:
    """All tables of a page, by name; those without rows are left out. Without results: none."""
    for module in iter_modules([str(Path(__file__).parent)]):
        import_module(f"stages.report.tables.{module.name}")
    frames = dict[str, pd.DataFrame]()
    if not results:
        return frames
    for name, function in TABLES[page].items():
        made = function(results)
        frames |= {name: made} if isinstance(made, pd.DataFrame) else dict(made or {})
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
