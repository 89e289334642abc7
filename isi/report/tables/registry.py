"""Every table is one function that gives its frame; its name is that of the file."""

from collections.abc import Callable, Mapping
from functools import partial, wraps
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, TypeVar

import pandas as pd

from isi.report.tables.forms import files
from isi.tables.io import atomically, keep_only

#: A function from results to a frame, to frames by name, or to None where there are no data.
Frames = Mapping[str, pd.DataFrame]
Made = pd.DataFrame | Frames | None
F = TypeVar("F", bound=Callable[[Any], Made])
#: Functions by page, then by name of the table.
TABLES: dict[str, dict[str, Callable[[Any], Made]]] = {}


def table(page: str) -> Callable[[F], F]:
    """Register a function as the table of its name on a page."""

    def register(function: F) -> F:
        TABLES.setdefault(page, {})[function.__name__] = function
        return function

    return register


def of_each_graph(function: Callable[[Any, Any], pd.DataFrame | None]) -> Callable[[Any], Frames]:
    """A function of results and one experiment, for every experiment with one source: names end
    with the experiment's suffix.
    """

    @wraps(function)
    def of_results(results: Any) -> Frames:
        frames = {
            f"{function.__name__}{experiment.suffix}": function(results, experiment)
            for experiment in results.standalone
        }
        return {name: frame for name, frame in frames.items() if frame is not None}

    return of_results


def frames_of(page: str, results: Any) -> dict[str, pd.DataFrame]:
    """All tables of a page, by name; those without rows are left out."""
    for module in iter_modules([str(Path(__file__).parent)]):
        import_module(f"isi.report.tables.{module.name}")
    frames = dict[str, pd.DataFrame]()
    for name, function in TABLES[page].items():
        made = function(results)
        frames |= {name: made} if isinstance(made, pd.DataFrame) else dict(made or {})
    return {name: frame for name, frame in frames.items() if len(frame)}


def write(page: str, results: Any, folder: Path) -> None:
    """Write the tables of a page into a folder, each file atomically; delete those of before."""
    written = list[Path]()
    for name, frame in frames_of(page, results).items():
        for form, text in files(frame).items():
            path = folder / f"{name}.{form}"
            atomically(path, partial(Path.write_bytes, data=text.encode()))
            written.append(path)
    keep_only(folder, written)
