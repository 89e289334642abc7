"""The report on valid but unusual results:
a dash, a sentence or a one-line error, never a traceback.
"""

import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

from isi.errors import InputError
from isi.report import data, paper_values
from isi.report.page import Page
from isi.tables import paths
from tests.reports import INITIALIZERS, ROOT, part_of, shown, small_results, svg_alone
from tests.unusual_results import STRANGE, changed, of_experiments, tied

SHIPPED = yaml.safe_load((ROOT / "params.yaml").read_text("utf-8"))["initializers"]


def few_results(
    studies: bool = True, names: Collection[str] = ("xavier", "es", "rs", "mean")
) -> data.Results:
    """Results of one experiment with few initializers;
    a report of all initializers takes three times as long.
    """
    models = {name: SHIPPED[name] for name in INITIALIZERS if name in names}
    return small_results(
        ["home"], studies, initializers=models, **{"sweep.initializers": {"es": {}}}
    )


def words(folder: Path) -> str:
    """The text of the page in a folder, without scripts."""
    text = re.sub(
        r"<(script|style).*?</\1>", " ", (folder / "index.html").read_text("utf-8"), flags=re.DOTALL
    )
    return re.sub(r"<[^>]*>", " ", text)


def written(folder: Path, found: data.Results) -> Path:
    """Write a report into a folder, and check that it has no NaN and no infinity."""
    with svg_alone():
        Page.of("report").write(folder, found)
        Page.of("beyond").write(folder / "beyond", found)
    assert not {"nan", "inf", "nan.0"} & set(re.findall(r"[\w.]+", words(folder)))
    assert not re.search(r"NaN|Infinity", (folder / "metrics.json").read_text("utf-8"))
    return folder


@st.composite
def strange(draw: st.DrawFn) -> data.Results:
    """Results of random experiments and initializers, with up to three changes of ``STRANGE``."""
    names = draw(st.sampled_from([("home",), ("moved",), ("away",), ("home", "moved")]))
    chosen = draw(st.sets(st.sampled_from(INITIALIZERS), min_size=1, max_size=3))
    models = {name: SHIPPED[name] for name in INITIALIZERS if name in chosen}
    found = small_results(
        names, False, initializers=models, plots={"initializers": [next(iter(models))]}
    )
    for what in draw(st.sets(st.sampled_from(sorted(STRANGE)), max_size=3)):
        found = STRANGE[what](found)
    return found


@settings(
    max_examples=3,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
@given(found=strange())
# without Xavier to compare them with
@example(found=few_results(studies=False, names=("es", "mean")))
def test_strange_results_make_a_whole_report(
    tmp_path_factory: pytest.TempPathFactory, found: data.Results
) -> None:
    written(tmp_path_factory.mktemp("report"), found)


@pytest.mark.parametrize(
    "what", ["there are no queries", "a paper that states nothing", "studies without rows"]
)
def test_analyses_of_strange_results_are_shown_too(tmp_path: Path, what: str) -> None:
    assert "–" in words(written(tmp_path, STRANGE[what](few_results())))


def test_a_collapsed_model_is_named() -> None:
    plain = small_results(["home"], studies=False)
    assert "Collapsed" not in shown("immediate", plain)[0]
    text, _, _ = shown("immediate", of_experiments(plain, tied))
    # in each of the 4 cells of |ξ| = 1 and 2 and two seeds: 10,000 ties over 4 triples
    assert text.startswith("**Collapsed on the home graph:** ")
    assert "Xavier (competitors tied with the answers of a triple: 2,500)" in text


def noisy(found: data.Results, size: float) -> data.Results:
    """Results with every measure changed by a random share of at most ``size``."""
    rng = np.random.default_rng(5)

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        columns = [
            name
            for name in frame
            if str(name).startswith(("mrr", "valid_mrr")) or name in ("x", "y")
        ]
        return frame.assign(
            **{
                str(name): frame[name] * (1 + size * rng.uniform(-1, 1, len(frame)))
                for name in columns
            }
        )

    return changed(found, change)


def lines(folder: Path) -> dict[tuple[str, int], str]:
    """All lines of the text files of a report, by file and line number."""
    return {
        (str(path.relative_to(folder)), number): line
        for path in sorted(folder.rglob("*.*"))
        if path.suffix != ".png"
        for number, line in enumerate(path.read_text("utf-8").splitlines())
    }


def test_noise_of_another_processor_changes_nothing_but_what_lies_between_two_roundings(
    tmp_path: Path,
) -> None:
    plain = few_results()
    folders = [tmp_path / name for name in ("plain", "little", "more")]
    with svg_alone():
        for folder, size in zip(folders, (0, 1e-9, 1e-6), strict=True):
            Page.of("report").write(folder, noisy(plain, size))
    first, little, more = (lines(folder) for folder in folders)
    assert little == first
    assert first.keys() == more.keys()
    assert sum(line != more[place] for place, line in first.items()) < 0.005 * len(first)


BROKEN: list[tuple[str, str | bytes, str]] = [
    ("values", "graph: [1, 2", "line 1: expected YAML"),
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
def test_the_papers_values_are_refused_in_one_line_where_it_is_broken(
    tmp_path: Path, name: str, content: str | bytes, said: str
) -> None:
    path = tmp_path / f"{name}.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as refused:
        paper_values.read(
            path, paper_values.VALUES if name == "values" else paper_values.VOCABULARY
        )
    assert str(path) in str(refused.value)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_any_part_of_the_papers_values_may_be_missing(tmp_path: Path) -> None:
    whole = yaml.safe_load((ROOT / paths.PAPER).read_text("utf-8"))
    plain, path = small_results(["home"], studies=False), tmp_path / "values.yaml"
    names = {
        part: [None, *(values if isinstance(values, dict) else [])]
        for part, values in whole.items()
    }
    for key, within in ((part, name) for part in names for name in names[part]):
        less = {**whole, key: {**whole[key], within: None} if within else None}
        path.write_text(yaml.safe_dump(less), "utf-8")
        read = paper_values.read(path)
        assert read.keys() == paper_values.VALUES().model_dump().keys()
        if not within:
            for section in ("paper", "graph", "convergence"):
                assert part_of(section, replace(plain, paper=read))
