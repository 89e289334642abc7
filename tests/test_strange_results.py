"""The report on results that are lawful and strange: a dash, a sentence or one line, and never a traceback."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from isi.errors import InputError
from isi.report import contents, page, results, stated, steady
from isi.report.figures import panels, rendered
from isi.report.sections import at_once, explorer, graph
from isi.tables import paths
from tests.reports import INITIALIZERS, ROOT, small_results
from tests.strange import STRANGE, changed, of_experiments, tied

SHIPPED = yaml.safe_load((ROOT / "params.yaml").read_text("utf-8"))["initializers"]


def words(folder: Path) -> str:
    """What a page says, its scripts apart."""
    text = re.sub(r"<(script|style).*?</\1>", " ", (folder / "index.html").read_text("utf-8"), flags=re.DOTALL)
    return re.sub(r"<[^>]*>", " ", text)


def written(folder: Path, found: results.Results) -> Path:
    """A report of it, which has no number that is none."""
    page.write(folder, found, contents.SECTIONS)
    assert not {"nan", "inf", "nan.0"} & set(re.findall(r"[\w.]+", words(folder)))
    assert not re.search(r"NaN|Infinity", (folder / "metrics.json").read_text("utf-8"))
    return folder


@st.composite
def strange(draw: st.DrawFn) -> results.Results:
    """Some experiments, some initializers, and up to three things that are strange."""
    names = draw(st.sampled_from([("home",), ("moved",), ("away",), ("home", "moved")]))
    chosen = draw(st.sets(st.sampled_from(INITIALIZERS), min_size=1, max_size=3))
    models = {name: SHIPPED[name] for name in INITIALIZERS if name in chosen}
    found = small_results(names, False, initializers=models, plots={"initializers": [next(iter(models))]})
    for what in draw(st.sets(st.sampled_from(sorted(STRANGE)), max_size=3)):
        found = STRANGE[what](found)
    return found


@settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(found=strange())
def test_strange_results_make_a_whole_report(tmp_path_factory: pytest.TempPathFactory, found: results.Results) -> None:
    written(tmp_path_factory.mktemp("report"), found)


@pytest.mark.parametrize("what", ["nothing is asked", "a paper that states nothing", "studies without rows"])
def test_studies_of_strange_results_are_shown_too(tmp_path: Path, what: str) -> None:
    assert "–" in words(written(tmp_path, STRANGE[what](small_results(["home"]))))


@pytest.mark.parametrize("table", ["places", "answers"])
@pytest.mark.parametrize("left", [0, -1], ids=["none", "one less"])
def test_what_the_explorer_lacks_is_told_in_one_line(table: str, left: int) -> None:
    found = small_results(["home"])
    assert found.explorer is not None
    of_models = found.explorer.found[table]
    if table == "answers":  # the first are shown: one less is no lack
        of_models = of_models[of_models["entity"] == of_models["entity"].iloc[-1]] if left else of_models
        left = 0
    rows = {**found.explorer.found, table: of_models.iloc[:left]}
    lacking = replace(found, explorer=replace(found.explorer, found=rows))
    says = "expected places and answers of each entity after each step, but .* lacks$"
    with pytest.raises(InputError, match=rf"^data/analyses/explorer/home\.\*\.parquet: {says}"):
        list(explorer.SECTION.contents(lacking))


def test_a_collapsed_model_is_told() -> None:
    plain = small_results(["home"], studies=False)
    assert not list(at_once.collapsed(plain.experiments["home"]))
    (told,) = at_once.collapsed(of_experiments(plain, tied).experiments["home"])
    # in each of the 4 cells of |ξ| = 1 and 2 and two seeds: 10,000 ties over 4 triples
    assert told.startswith("**Collapsed on the home graph:** ")
    assert "Xavier (rivals tied with an answer: 2,500)" in told


def noisy(found: results.Results, size: float) -> results.Results:
    """The same with every measure changed by up to a share, each by itself."""
    rng = np.random.default_rng(5)

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        columns = [name for name in frame if str(name).startswith(("mrr", "valid_mrr")) or name in ("x", "y")]
        return frame.assign(
            **{str(name): frame[name] * (1 + size * rng.uniform(-1, 1, len(frame))) for name in columns}
        )

    return changed(found, change)


def lines(folder: Path) -> dict[tuple[str, int], str]:
    """Of every text file of a report, its lines."""
    return {
        (str(path.relative_to(folder)), number): line
        for path in sorted(folder.rglob("*.*")) if path.suffix != ".png"
        for number, line in enumerate(path.read_text("utf-8").splitlines())
    }  # fmt: skip


def test_noise_of_another_processor_changes_nothing_but_what_lies_between_two_roundings(tmp_path: Path) -> None:
    plain = small_results(["home"])
    folders = [tmp_path / name for name in ("plain", "little", "more")]
    for folder, size in zip(folders, (0, 1e-9, 1e-6), strict=True):
        page.write(folder, noisy(plain, size), contents.SECTIONS)
    first, little, more = (lines(folder) for folder in folders)
    assert little == first
    assert first.keys() == more.keys()
    assert sum(line != more[place] for place, line in first.items()) < 0.005 * len(first)
    for path in (folders[0] / "figures").glob("*.png"):
        assert (folders[1] / "figures" / path.name).read_bytes() == path.read_bytes()


def test_numbers_of_files_have_two_decimals_or_four_digits() -> None:
    frame = pd.DataFrame({"a": [1.23456, None, -0.001], "p": ["none", 1.86265e-9, 0.123456], "n": [1, 2, 3]})
    assert steady.csv(frame, ("p",)) == "a,p,n\n1.23,none,1\n,1.863e-09,2\n0,0.1235,3\n"
    counts = pd.DataFrame({"p": [24941.0, 14759.0, 77.00000001, 12345.678]})
    assert steady.csv(counts, ("p",)) == "p\n24941\n14759\n77\n12345.68\n"
    assert steady.number(-0.004) == 0
    assert str(steady.number(-0.004)) == "0.0"


def test_a_figure_is_drawn_from_rounded_values() -> None:
    drawings = []
    for noise in (0, 1e-6):
        canvas, (axes,) = panels(1, 1)
        axes.plot([1, 2, 3], np.array([40.123, 45.678, 60.111]) * (1 + noise))
        axes.fill_between([1, 2, 3], np.array([39.21, 44.12, 58.33]) * (1 + noise), [41, 46, 62])
        axes.annotate("here", (2, 45.678 * (1 + noise)), (1.5, 50 * (1 + noise)), arrowprops={"arrowstyle": "-"})
        axes.axhline(50.005 * (1 + noise))
        steady.steady(canvas)
        drawings.append((rendered(canvas, "svg"), rendered(canvas, "png")))
        assert axes.get_ylim() == pytest.approx((38, 63.2), abs=0.3)
    assert drawings[0] == drawings[1]


BROKEN: list[tuple[str, Any, str]] = [
    ("values", "graph: [1, 2", "line 1: expected YAML"),
    ("values", "just text", "expected a mapping of keys to values"),
    ("values", b"\xff\xfe\x00g", "expected YAML"),
    ("values", "graph: {entities: many}", "graph.entities"),
    ("values", "graph: {entities: .nan}", "graph.entities"),
    ("values", "grahp: {}", "grahp"),
    ("values", "indicators: {es: true}", "indicators.es"),
    ("values", "indicators: {esp: 8}", "expected the name of an initializer"),
    ("values", "convergence: {epochs: {es: 16.6}}", "convergence.epochs.es"),
    ("values", "transfer: 5", "transfer"),
    ("vocabulary", "kinds: object", "kinds"),
    ("vocabulary", "bowls_in_cabinets: {head: []}", "bowls_in_cabinets.head"),
    ("vocabulary", "bowls_in_cabinets: {top: [bowl]}", "bowls_in_cabinets.top"),
    ("vocabulary", "relations: {atLocation: 3}", "relations.atLocation"),
]


@pytest.mark.parametrize(("name", "content", "said"), BROKEN)
def test_what_the_paper_states_is_refused_in_one_line_where_it_is_broken(
    tmp_path: Path, name: str, content: Any, said: str
) -> None:
    path = tmp_path / f"{name}.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as refused:
        stated.read(path, stated.Paper if name == "values" else stated.Vocabulary)
    assert str(path) in str(refused.value)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("name", "content", "said"), [BROKEN[place] for place in (0, 2, 3, 10)])
def test_the_stage_refuses_it_before_anything_is_read_or_written(
    tmp_path: Path, name: str, content: Any, said: str
) -> None:
    for part in ("isi", "stages", "beyond", "dvc.yaml", "params.yaml"):
        (tmp_path / part).symlink_to(ROOT / part)
    folder = tmp_path / paths.PAPER.parent
    shutil.copytree(ROOT / paths.PAPER.parent, folder)
    (folder / f"{name}.yaml").write_bytes(content if isinstance(content, bytes) else content.encode())
    command = [sys.executable, "-m", "stages.report"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
    (line,) = ended.stderr.splitlines()
    assert (ended.returncode, ended.stdout) == (1, "")
    assert line.startswith(f"report: {paths.PAPER.parent}/{name}.yaml: ")
    assert said in line
    assert len(line) < 300
    assert not (tmp_path / paths.REPORTS).exists()


def leaves(values: Any, key: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The keys of every value."""
    if not isinstance(values, dict):
        return [key]
    return [key, *(place for name, value in values.items() for place in leaves(value, (*key, name)))][bool(not key) :]


def test_any_part_of_what_the_paper_states_may_be_missing(tmp_path: Path) -> None:
    whole = (ROOT / paths.PAPER).read_text("utf-8")
    home = small_results(["home"], studies=False).experiments["home"]
    for place in leaves(yaml.safe_load(whole)):
        values = yaml.safe_load(whole)
        within = values
        for name in place[:-1]:
            within = within[name]
        within[place[-1]] = None
        path = tmp_path / "values.yaml"
        path.write_text(yaml.safe_dump(values), "utf-8")
        found = small_results(["home"], studies=False)
        found = results.Results(**{**vars(found), "paper": stated.read(path, stated.Paper)})
        for section in contents.SECTIONS:
            if section.id in ("paper", "transfer"):
                list(section.contents(found))
        list(islice(graph.of_graph(found, home), 9))
        at_once.in_words(home.at_once, home.initializers, found.paper["immediate"]["improvement_over_xavier"])
