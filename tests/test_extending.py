"""Each extension in docs/extending.md works as the page says, with the page's own code."""

import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from matplotlib.figure import Figure
from torch.nn.functional import normalize

import isi
from isi.__main__ import main
from isi.cli import entity as entity_commands
from isi.errors import InputError
from isi.home.phrases import with_words
from isi.initializers.api import INITIALIZERS, InitResult, Registered, options_of
from isi.models.model import make_model
from isi.models.stack import uniform
from isi.sources import Source
from isi.tables import paths
from stages import check_params, pipeline
from stages.files import TRIPLES
from stages.report import charts, figures, page
from stages.report.tables import registry, results
from stages.report.tables.data import Experiment, ModelLabels
from stages.report.tables.estimates import MEASURES
from stages.trace_trajectory import traced
from tests.documented import DOCS, PAGE, block, code, params
from tests.imports import PLUMBING, imported
from tests.small_bundle import home_of, small, worded
from tests.small_graphs import score_all
from tests.small_insertion import insertion
from tools.workspace import change_all


@pytest.fixture
def _report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables of the report that the test registers are forgotten after it."""
    of_page, names = registry.TABLES["report"], registry.names_of("report")
    monkeypatch.setattr(of_page, "_registered", {name: of_page.get(name) for name in names})


@pytest.fixture
def own(
    registries: None,  # noqa: ARG001
    _report: None,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> ModuleType:
    """The module that docs/extending.md shows for an extension."""
    module = ModuleType(request.param.replace(" ", "_"))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(code(request.param), request.param, "exec"), module.__dict__)  # noqa: S102
    return module


@pytest.mark.parametrize("own", ["own initializer"], indirect=True)
@pytest.mark.usefixtures("own")
def test_an_initializer() -> None:
    given, (shown,) = insertion(), params("own initializer params").values()
    assert "needs_are_what_it_uses" in isi.check_initializer("nearest")
    result = INITIALIZERS.get("nearest", "").function(
        given, **options_of("nearest", shown, "initializers.nearest")
    )
    units = normalize(given.words, dim=-1)
    for model, entity in enumerate(given.novel[:, 0].tolist()):
        able = given.eligible[model] & (given.words != 0).any(-1)
        nearest = int((units @ units[entity]).masked_fill(~able, -2).argmax())
        torch.testing.assert_close(
            result.vectors[model, 0], shown["scale"] * given.theta0.entity[model, nearest]
        )


@pytest.mark.parametrize("own", ["own initializer"], indirect=True)
@pytest.mark.usefixtures("own")
def test_an_initializer_serves_commands_and_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    vectors = tmp_path / "vectors.txt"
    vectors.write_text("3 2\nkettle 1 0\nbed 0 1\nteapot 0.8 0.6\n", encoding="utf-8")
    home = ["--home", str(home_of(tmp_path / "home", with_words(small(), vectors))), "--json"]
    main(["tell", "teapot", "atLocation", "bedroom", "--initializer", "nearest", *home])
    inserted = json.loads(capsys.readouterr().out)["explanation"]
    main(["explain", "teapot", *home])
    explained = json.loads(capsys.readouterr().out)
    for answer in (inserted, explained):
        assert answer["initializer"] == "nearest"
        assert [(each["entity"], each["weight"]) for each in answer["indicators"]] == [
            ("kettle", 1.0)
        ]


def example(*models: str) -> Experiment:
    """Runs of models, and of the joint model, with two novel entities and two seeds."""
    scopes, joint = ("known", "novel", "weighted", "known_closed"), "joint"
    rows = [*product((*models, joint), scopes, (0, 1), (0, 1, 2))]
    runs = pd.DataFrame(rows, columns=["model", "scope", "seed", "epoch"])
    runs = runs[(runs["model"] != joint) | (runs["epoch"] == 0)]
    runs = runs.assign(size=2, queries=4, **dict.fromkeys(MEASURES, 0.5))
    labels = ModelLabels.registered()
    experiment = Experiment("home", "home", labels, list(models), runs, None, 0.08, 9, list(models))
    experiment.__dict__["curves"] = runs
    return experiment


def drawn(panel: charts.Panel) -> set[str]:
    """The names for which a panel has values."""
    return {value.name for value in panel.draw(Figure().subplots())}


@pytest.mark.parametrize("own", ["own initializer"], indirect=True)
@pytest.mark.usefixtures("own")
def test_an_initializer_is_in_figures_by_its_label(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = example("xavier", "nearest")
    of_experiment: Any = SimpleNamespace(standalone=[experiment])
    immediate: Any = results.immediate(of_experiment)
    assert immediate["model"].tolist() == ["Xavier", "Nearest", "Joint"]
    by_size: Any = results.immediate_by_size(of_experiment)
    curves: Any = results.curves(of_experiment)
    panels = [*figures.figure3a(by_size), *figures.figure3b(curves), *figures.figure4(curves)]
    assert len(panels) == 3 + 1 + 1
    assert all({"Xavier", "Nearest"} <= drawn(panel) for panel in panels)
    assert traced(["mean", "nearest"]) == ["nearest"]  # figure 1
    parts: Any = results.answer_parts(
        SimpleNamespace(standalone=[example("xavier", "es", "nearest")])
    )
    assert "Nearest" in set(parts["part"])
    monkeypatch.setitem(charts.PALETTE["models"], "Nearest", ["#123456", "-", "o"])
    assert charts.style_of("Nearest")["color"] == "#123456"
    monkeypatch.setitem(charts.PALETTE, "without_line", ["Nearest"])
    assert not any("Nearest" in drawn(panel) for panel in figures.figure3a(by_size))


#: A result for 2 models of 16 entities, with 3 novel entities each and 8 numbers in a vector.
SOUND = InitResult(torch.ones(2, 3, 8, dtype=torch.float64), torch.zeros(2, 3))
#: Results, or changes of the sound one, and words of the refusal.
WRONG: list[tuple[Any, list[str]]] = [
    ({"vectors": torch.zeros(1, 2, 3)}, ["vectors of shape (2, 3, 8)", "got (1, 2, 3)"]),
    ({"vectors": np.zeros((2, 3, 8))}, ["vectors of shape (2, 3, 8)", "got ndarray"]),
    ({"vectors": torch.full((2, 3, 8), torch.nan)}, ["vectors", "NaN"]),
    # of single precision
    ({"vectors": torch.full((2, 3, 8), 1e300, dtype=torch.float64)}, ["vectors", "huge"]),
    ({"fallback": torch.zeros(2)}, ["fallback of shape (2, 3)", "got (2,)"]),
    ({"fallback": None}, ["fallback of shape (2, 3)", "got NoneType"]),
    ({"weights": torch.zeros(2, 16)}, ["weights of shape (2, 3, 16)", "got (2, 16)"]),
    (torch.zeros(2, 3, 8), ["InitResult", "got Tensor"]),
    (None, ["InitResult", "got NoneType"]),
]


@pytest.mark.parametrize(("wrong", "words"), WRONG, ids=[" ".join(words) for _, words in WRONG])
def test_a_wrong_result_of_an_initializer_is_refused_in_one_line(
    wrong: Any, words: list[str]
) -> None:
    result = replace(SOUND, **wrong) if isinstance(wrong, dict) else wrong
    with pytest.raises(InputError) as refused:
        Registered("broken1", lambda _: result, "Broken").initialize(insertion(), {})
    for word in ["broken1", *words]:
        assert word in str(refused.value)


def test_numbers_of_another_precision_are_converted() -> None:
    result = Registered("sound", lambda _: SOUND, "Sound").initialize(insertion(), {})
    assert (result.vectors.dtype, result.fallback.dtype) == (torch.float32, torch.int64)
    assert (result.vectors.double() == SOUND.vectors).all()


@pytest.mark.parametrize("own", ["own model"], indirect=True)
@pytest.mark.usefixtures("own")
def test_a_model() -> None:
    options = params("own model params")["models.transh"]
    scoring = make_model("transh", options, "models.transh")
    assert "maps_undo_each_other" in isi.check_model("transh", options)
    everyone = torch.ones(2, 6, dtype=torch.bool)
    theta = uniform(everyone, 3, scoring, 4, 0.5, 0, torch.tensor([[0], [1]]))
    scores = score_all(theta)
    for model, relation, head, tail in np.ndindex(2, 3, 6, 6):
        normal, translation = theta.relation[model, relation].double().split(4)
        normal = normal / normal.norm()
        ends = [v - (v @ normal) * normal for v in theta.entity[model, [head, tail]].double()]
        expected = scoring.margin - (ends[0] + translation - ends[1]).norm()
        assert abs(float(scores[model, relation, head, tail]) - float(expected)) < 1e-5


@pytest.mark.usefixtures("registries")
def test_a_model_with_defaults_is_checked_without_options(monkeypatch: pytest.MonkeyPatch) -> None:
    of_page, with_defaults = '"transh")', '"transh", defaults={"margin": 4.0})'
    text = code("own model")
    assert f"`@register_model({with_defaults}`" in PAGE.read_text(encoding="utf-8")
    assert text.count(of_page) == 1
    module = ModuleType("own_model")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(text.replace(of_page, with_defaults), "own", "exec"), module.__dict__)  # noqa: S102
    assert isi.check_model("transh")


@pytest.mark.parametrize("own", ["own source"], indirect=True)
@pytest.mark.usefixtures("own")
def test_a_source(tmp_path: Path) -> None:
    path, (settings,) = tmp_path / "notebook.csv", params("own source params").values()
    path.write_text(
        "head,relation,tail,count\nspoon,liesIn,drawer,3\ndrawer,isPartOf,table,1\n",
        encoding="utf-8",
    )
    source = Source(settings | {"path": str(path)}, "sources.notebook", 0)
    (table,) = source.frames()
    rows = Counter(
        {
            (row["head"], row["relation"], row["tail"]): row["count"]
            for row in table.to_dict("records")
        }
    )
    assert rows == {("spoon", "liesIn", "drawer"): 3, ("drawer", "isPartOf", "table"): 1}
    assert source.kinds.to_numpy().tolist() == [
        [name, "thing", name] for name in ("drawer", "spoon", "table")
    ]


@pytest.fixture
def _page_with_items(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, _report: None
) -> Iterator[None]:
    """The first page lists the items that docs/extending.md adds, and figures have its function."""
    entries = block("own table entry", "yaml") + block("own figure entry", "yaml")
    before, below, after = page._ITEMS.read_text(encoding="utf-8").partition("\n  items:\n")
    assert "\nreport:\n" in before
    file = tmp_path / "items.yaml"
    file.write_text(f"{before}{below}{entries}{after}", encoding="utf-8")
    of_figures = dict(vars(figures))
    exec(compile(code("own figure"), "own figure", "exec"), of_figures)  # noqa: S102
    monkeypatch.setattr(page, "_ITEMS", file)
    monkeypatch.setattr(figures, "query_counts", of_figures["query_counts"], raising=False)
    page.pages.cache_clear()
    yield
    page.pages.cache_clear()


@pytest.mark.parametrize("own", ["own table"], indirect=True)
@pytest.mark.usefixtures("own", "_page_with_items")
def test_a_table_and_a_figure_of_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reports, outputs = tmp_path / "reports", SimpleNamespace(experiments=[example("xavier")])
    with monkeypatch.context() as patch:
        patch.setattr(registry, "names_of", lambda _: ["query_counts"])  # others need a run
        registry.write("report", outputs, reports / "tables")
    names = {f"query_counts.{form}" for form in ("csv", "md", "tex")}
    assert {path.name for path in (reports / "tables").iterdir()} == names
    counts = pd.read_csv(reports / "tables/query_counts.csv")
    assert counts.set_index("scope")["queries"].to_dict() == dict.fromkeys(counts["scope"], 4)
    shown = page.write("report", reports).read_text(encoding="utf-8")
    for text in ('id="table-query_counts"', 'id="figure-query_counts_figure"', "averaged over"):
        assert text in shown
    for form in ("svg", "png"):
        assert (reports / f"figures/query_counts_figure.{form}").stat().st_size


@pytest.mark.parametrize("own", ["own stage"], indirect=True)
def test_a_stage(own: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = block("own stage dvc", "yaml")
    (tmp_path / "dvc.yaml").write_text(entry, encoding="utf-8")
    (tmp_path / "params.yaml").write_text("experiments: {home: {}}\n", encoding="utf-8")
    (tmp_path / "stage.py").write_text(code("own stage"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    columns = {"head": ["mug", "cup"], "relation": "in", "tail": "bowl", "count": 2, "source": "x"}
    TRIPLES.write(pd.DataFrame(columns), "test", experiment="home")
    (stage,) = yaml.safe_load(entry)["stages"].values()
    command = stage["cmd"].replace("${item.experiment}", "home").split()
    monkeypatch.setattr(sys, "argv", command[3:])
    assert command[:3] == ["exec", "python", "-m"]
    getattr(own, command[3].removeprefix("stages."))()
    (output,) = (out.replace("${item.experiment}", "home") for out in stage["outs"])
    counts = pd.read_parquet(output).set_index("entity")["triples"]
    assert counts.to_dict() == {"bowl": 2, "cup": 1, "mug": 1}
    imported_files = {f"{name.replace('.', '/')}.py" for name in imported(tmp_path / "stage.py")}
    plumbing = {str(path) for path in PLUMBING}
    for file in imported_files - plumbing:
        if (DOCS.parent / file).exists():
            assert any(file.startswith(dep) for dep in stage["deps"]), file


def test_a_sentence_of_what_is_printed_after_an_insertion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = home_of(tmp_path / "home", worded(tmp_path, teapot=[0.8, 0.6, 0]))
    command = ["tell", "teapot", "atLocation", "bedroom", "--dry-run", "--home", str(home)]
    command += ["--initializer", "es", "--set", "k=1"]
    main(command)
    before = capsys.readouterr().out.splitlines()
    text = Path(entity_commands.__file__).read_text(encoding="utf-8")
    start, inside, rest = text.partition("def in_words(")
    body, after, end = rest.partition("\n\n\n")
    call = block("own sentence call", "python").rstrip("\n")
    text = f"{start}{code('own sentence')}\n\n{inside}{body}\n{call}{after}{end}"
    module = ModuleType(entity_commands.__name__)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(text, "entity.py", "exec"), module.__dict__)  # noqa: S102
    main(command)
    after_it = capsys.readouterr().out.splitlines()
    (sentence,) = set(after_it) - set(before)
    assert sentence == "its words are 80% like those of kettle"
    assert [line for line in after_it if line != sentence] == before


@pytest.mark.usefixtures("registries")
def test_params_of_all_extensions_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for mark in ("own initializer", "own model", "own source"):
        module = ModuleType(mark.replace(" ", "_"))
        monkeypatch.setitem(sys.modules, module.__name__, module)
        exec(compile(code(mark), mark, "exec"), module.__dict__)  # noqa: S102
    files = {paths.PARAMS: "initializer model source experiment", pipeline.BEYOND_PARAMS: "graph"}
    for path, marks in files.items():
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
        for mark in marks.split():
            change_all(values, params(f"own {mark} params"))
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    checked = check_params.load(tmp_path / paths.PARAMS)
    assert "nearest" in checked.initializers_of("paper")
    assert checked.of("notebook").training.batch_size == 128
    beyond = check_params.load_beyond(checked, tmp_path / pipeline.BEYOND_PARAMS)
    assert beyond.graphs["second_notebook"].sessions.sizes == [5]
