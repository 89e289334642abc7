"""Each extension in docs/extending.md works as the page says, with the page's own code."""

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import normalize

import isi
from isi.__main__ import main
from isi.errors import InputError
from isi.home.phrases import with_words
from isi.initializers.api import INITIALIZERS, InitResult, Registered, options_of
from isi.models.model import make_model
from isi.models.stack import uniform
from isi.sources import Source
from tests.documented import code, params
from tests.small_bundle import home_of, small
from tests.small_graphs import score_all
from tests.small_insertion import insertion


@pytest.fixture
def own(
    registries: None,  # noqa: ARG001
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
    inserted = json.loads(capsys.readouterr().out)["report"]
    main(["explain", "teapot", *home])
    explained = json.loads(capsys.readouterr().out)
    for answer in (inserted, explained):
        assert answer["initializer"] == "nearest"
        assert [(each["entity"], each["weight"]) for each in answer["indicators"]] == [
            ("kettle", 1.0)
        ]


@pytest.mark.parametrize("own", ["own initializer"], indirect=True)
@pytest.mark.usefixtures("own")
def test_a_command_takes_the_options_of_an_initializer_from_the_params_of_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = str(home_of(tmp_path / "home"))
    command = ["insert", "teapot", "--initializer", "nearest", "--home", home]
    monkeypatch.chdir(tmp_path)

    def scale(*more: str) -> float:
        main([*command, "--dry-run", "--json", *more])
        return float(json.loads(capsys.readouterr().out)["report"]["options"]["scale"])

    assert scale() == 1.0  # its default
    for listed, expected in (
        ("nearest: {scale: 0.5}", 0.5),
        ("es: {k: 3}", 1.0),
        ("nearest: null", 1.0),
    ):
        Path("params.yaml").write_text(f"initializers: {{{listed}}}\n", encoding="utf-8")
        assert scale() == expected
    assert scale("--set", "scale=2.0") == 2.0
    Path("params.yaml").write_text("initializers: {nearest: 3}\n", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"params\.yaml: initializers\.nearest: .*got 3"):
        scale()
    Path("params.yaml").write_text("seed: 3\n", encoding="utf-8")  # of another program
    assert scale() == 1.0


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
