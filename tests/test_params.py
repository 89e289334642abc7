"""Values that ``params.yaml`` may have, and the messages for values that are refused."""

import operator
import re
from collections.abc import Callable, Iterator
from functools import reduce
from pathlib import Path
from typing import Any, Literal

import pytest
import yaml

from isi.config import Count, check, keywords, options
from isi.errors import InputError
from isi.initializers.api import INITIALIZERS, initializer
from isi.initializers.paper import mean
from isi.tables import paths
from isi.training.trainer import Training
from stages.check_params import Params, check_params, load
from stages.params import CONDITIONS, StageParams
from stages.trace_trajectory import traced
from tests.small_params import small_params
from tools.workspace import DROP, change_all


def changed(tmp_path: Path, changes: dict[str, Any]) -> Params:
    """The params of the repository with values changed at dotted keys."""
    raw = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    change_all(raw, changes)
    path = tmp_path / "params.yaml"
    path.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
    return load(path)


HOUSES: dict[str, object] = {
    "reader": "mp3d_houses",
    "folder": "houses",
    "category": "mpcat40",
    "rooms": {"k": "kitchen"},
    "vocabulary": "data/raw/mp3d/vocabulary.yaml",
}


def test_the_params_of_the_repository_load_with_the_papers_values() -> None:
    params = load()
    sessions = params.experiments["ai2thor"].sessions
    assert (sessions.sizes, sessions.seeds) == ([*range(1, 11), 12, 14], 30)
    sessions = params.experiments["paper"].sessions
    assert (sessions.sizes, sessions.seeds, sessions.insert_from) == ([*range(1, 11)], 30, "all")
    of_paper = params.of("paper")
    assert (of_paper.training.batch_size, of_paper.negatives.mode) == (1, "sampled")
    assert (of_paper.finetuning.learning_rate, of_paper.finetuning.max_epochs) == (0.002, 150)
    assert params.initializers["xavier"] == {}
    assert params.initializers["ers"] == {"k": 9, "candidates": 30}


def lists_of_names(values: Any, key: str = "") -> Iterator[str]:
    """The dotted keys of lists of names of experiments and initializers."""
    if isinstance(values, dict):
        for name, value in values.items():
            yield from lists_of_names(value, f"{key}.{name}".lstrip("."))
    elif key.rpartition(".")[2] in ("experiments", "initializers") and isinstance(values, list):
        yield key


PARAMS = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))


@pytest.mark.parametrize("key", lists_of_names(PARAMS))
def test_an_unknown_name_in_any_list_is_reported_at_its_key(tmp_path: Path, key: str) -> None:
    names = reduce(operator.getitem, key.split("."), PARAMS)
    with pytest.raises(InputError, match=key.partition(".")[0]) as refused:
        changed(tmp_path, {key: [*names, "qxz"]})
    if key != "affordances.experiments":  # each of these has a list of entities, which is missed
        assert refused.value.place.startswith(key)


REFUSED = yaml.safe_load((Path(__file__).parent / "refused_params.yaml").read_text("utf-8"))
#: Unknown or missing keys.
KEYS = [*((key, 1) for key in REFUSED["unknown"]), *((key, DROP) for key in REFUSED["missing"])]
VALUES = [case for entry in REFUSED["wrong"] + REFUSED["disagreeing"] for case in entry.items()]


@pytest.mark.parametrize(("key", "value"), KEYS + VALUES)
def test_what_params_may_not_say_is_refused_by_its_key(
    tmp_path: Path, key: str, value: object
) -> None:
    with pytest.raises(InputError) as refused:
        changed(tmp_path, {key: value})
    line = str(refused.value)
    assert "\n" not in line
    assert f": {key}: " in line or (key, value) not in KEYS
    for part in key.split("."):  # a rule between two keys may name their section
        assert part in line.removeprefix(str(tmp_path))


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 0, "training.weight_decay": 0, "training.learning_rate": 1, "compute.workers": 1},
        {"sessions.insert_fraction": 1.0, "compute.workers": "all", "words.sha256": "0" * 64},
        {"embedding.dimension": 4, "cross_validation.dimension": []},
        # no blocks
        {"embedding.model": "distmult", "embedding.dimension": 7},
        {"cross_validation.experiments": [], "cross_validation.dimension": [30]},  # left out
        {"sweep.experiments": [], "sweep.size": 11},  # left out
        {
            "experiments.ai2thor.full_curves": [],
            "experiments.ai2thor.finetuned": {"initializers": "all", "seeds": 31},
        },
        {"experiments.ai2thor.initializers": ["xavier", "rs"], "experiments.paper.training": None},
        {
            "experiments.paper.sessions.split": None,
            "experiments.paper.sessions.insert_from": "train",
        },
        {"experiments.transfer.sessions.sizes": [50], "experiments.transfer.full_curves": [50]},
        {"experiments.paper": DROP},
        {"experiments.transfer": DROP, "affordances.experiments": [], "sweep.finetuned_seeds": 0},
        {"sweep.seeds": 30, "trajectory.seed": 29, "cross_validation.ratio": []},
        {
            "words.source": "word2vec-google-news-300",
            "sources.ai2thor.materials": "simulator",
            "sources.mp3d": HOUSES,
        },
        {"initializers.gaussian": DROP, "plots.initializers": ["xavier"]},
    ],
    ids=str,
)
def test_values_at_the_edge_of_their_range_are_accepted(
    tmp_path: Path, changes: dict[str, object]
) -> None:
    values = changed(tmp_path, changes).model_dump()
    for key, value in changes.items():
        *parents, last = key.split(".")
        section: Any = reduce(operator.getitem, parents, values)
        assert last not in section if value is DROP else section[last] == value


def test_a_trajectory_is_traced_from_the_papers_and_own_initializers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(INITIALIZERS, "_registered", dict(INITIALIZERS._registered))
    initializer("mine")(mean)
    assert traced(["mine", "mean", "ers", "map", "iu"]) == ["mine", "ers", "iu"]
    params = small_params(["home"]).model_copy(update={"initializers": {"mean": {}}})
    listed = params.sweep.model_copy(update={"initializers": {}})
    params = params.model_copy(
        update={"sweep": listed, "plots": params.plots.model_copy(update={"initializers": []})}
    )
    check_params(params)
    study = params.trajectory.model_copy(update={"experiments": ["home"]})
    with pytest.raises(InputError, match=r"trajectory\.experiments: expected no experiments"):
        check_params(params.model_copy(update={"trajectory": study}))


def test_settings_of_cross_validation_change_one_factor_of_the_choice_at_a_time(
    tmp_path: Path,
) -> None:
    few = {
        "experiments": [],
        "folds": 2,
        "dimension": [40],
        "ratio": [],
        "learning_rate": [0.1, 0.2],
    }
    settings = changed(tmp_path, {"cross_validation": few | {"weight_decay": [0]}}).settings
    assert [tuple(setting.model_dump().values()) for setting in settings] == [
        (100, 9, 0.1, 0.001),
        (40, 9, 0.1, 0.001),
        (100, 9, 0.2, 0.001),  # the rate of 0.1 is the choice
        (100, 9, 0.1, 0),
    ]
    moved = changed(tmp_path, {"training.learning_rate": 0.2})
    assert moved.settings[0].learning_rate == 0.2
    assert len(moved.settings) == 12  # 0.2 is listed and 0.1 is not


def test_conditions_of_an_experiment_replace_the_general_ones_key_by_key(tmp_path: Path) -> None:
    own = {"learning_rate": 0.5, "patience": 9}
    changes = {"experiments.ai2thor.training": own, "experiments.ai2thor.negatives": {"ratio": 2}}
    params = changed(tmp_path, changes)
    of = params.of("ai2thor")
    assert of.training == params.training.model_copy(update=own)
    assert of.negatives == params.negatives.model_copy(update={"ratio": 2})
    assert of.finetuning == params.finetuning
    assert params.of("transfer") == params


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("paper.training", {"batch_size": 0}, "experiments.paper.training.batch_size: "),
        ("transfer.finetuning", {"rate": 1}, "experiments.transfer.finetuning.rate: unknown key"),
    ],
)
def test_a_wrong_condition_is_named_where_it_stands(
    tmp_path: Path, key: str, value: object, says: str
) -> None:
    with pytest.raises(InputError, match=f": {re.escape(says)}"):
        changed(tmp_path, {f"experiments.{key}": value})


@pytest.mark.parametrize("wrong", ["sampled", [1], 3, True])
@pytest.mark.parametrize("section", CONDITIONS)
def test_a_stage_names_a_condition_that_is_no_mapping(section: str, wrong: object) -> None:
    values = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    own = {**values["experiments"]["paper"], section: wrong}
    experiments = {**values["experiments"], "paper": own}
    for changed, key in (
        ({"experiments": experiments}, f"experiments.paper.{section}"),
        ({section: wrong}, section),
    ):
        with pytest.raises(InputError) as refused:
            StageParams({**values, **changed}).of("paper")
        assert refused.value.args[:2] == (str(paths.PARAMS), key)


def test_a_wrong_condition_of_a_stage_is_named_where_it_stands() -> None:
    values = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    values["experiments"]["paper"]["training"] = {"batch_size": 0}
    with pytest.raises(InputError) as refused:
        StageParams(values).of("paper").read("training", Training)
    assert refused.value.place == "experiments.paper.training.batch_size"


def test_an_experiment_runs_all_initializers_or_those_that_it_lists_in_the_order_of_params(
    tmp_path: Path,
) -> None:
    params = changed(tmp_path, {"experiments.transfer.initializers": ["mean", "iu"]})
    assert params.initializers_of("ai2thor") == list(params.initializers)
    assert params.initializers_of("transfer") == ["iu", "mean"]


# Options from a signature


def cook(
    dish: str, minutes: Count, heat: Literal["low", "high"] = "low", *, salt: float = 0.5
) -> None: ...


def raw(dish: str) -> None: ...


def test_options_are_the_parameters_after_the_first_with_their_defaults() -> None:
    fields = options(cook).model_fields
    assert list(fields) == ["minutes", "heat", "salt"]
    assert [name for name, field in fields.items() if field.is_required()] == ["minutes"]
    assert keywords(cook, {"minutes": 3}, "recipes.soup") == {
        "minutes": 3,
        "heat": "low",
        "salt": 0.5,
    }
    assert (
        keywords(cook, {"minutes": 3, "heat": "high", "salt": 1}, "recipes.soup")["heat"] == "high"
    )
    assert keywords(raw, {}, "recipes.carrot") == {}


@pytest.mark.parametrize(
    ("function", "given", "named"),
    [
        (cook, {"minutes": 3, "heat": "medium"}, "recipes.soup.heat: .*got 'medium'"),
        (cook, {"minutes": 3, "dish": "stew"}, "recipes.soup.dish: "),
        (raw, None, "recipes.soup: .*got None"),
        (cook, [("minutes", 3)], "recipes.soup: "),
    ],
)
def test_options_that_a_function_does_not_take_are_refused_by_name(
    function: Callable[..., None], given: Any, named: str
) -> None:
    with pytest.raises(InputError, match=rf"^params\.yaml: {named}") as refused:
        keywords(function, given, "recipes.soup")
    assert "\n" not in str(refused.value)


def test_a_value_is_checked_against_any_type() -> None:
    assert check([1, 2], list[Count], "sizes") == [1, 2]
    with pytest.raises(InputError, match=r"^params\.yaml: sizes\.1: .*got 0$"):
        check([1, 0], list[Count], "sizes")
    with pytest.raises(InputError, match=r"^other\.yaml: seed: .*got None$"):
        check(None, Count, "seed", Path("other.yaml"))  # type: ignore[arg-type]
