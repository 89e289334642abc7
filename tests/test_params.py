"""What ``params.yaml`` may say, and how it is refused when it says something else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from isi import paths
from isi.errors import InputError
from isi.params import Params, load
from tools.workspace import change


def changed(tmp_path: Path, changes: dict[str, Any]) -> Params:
    """The params of the repository with values changed at dotted keys."""
    raw = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    for key, value in changes.items():
        change(raw, key, value)
    path = tmp_path / "params.yaml"
    path.write_text(yaml.safe_dump(raw), encoding="utf-8")
    return load(path)


def refusal(tmp_path: Path, text: str | bytes) -> str:
    """The one line that refuses a file of this text."""
    path = tmp_path / "params.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError) as refused:
        load(path)
    line = str(refused.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    return line.removeprefix(f"{path}: ")


def renamed(key: str, misspelt: str) -> str:
    text = paths.PARAMS.read_text(encoding="utf-8")
    assert text.count(key) == 1
    return text.replace(key, misspelt)


def test_the_params_of_the_repository_load_with_the_papers_values() -> None:
    params = load(paths.PARAMS)
    assert params.sessions.sizes == list(range(1, 11))
    assert params.sessions.seeds == 30
    assert params.initializers.options("xavier") == {}
    assert params.initializers.options("ers") == {"k": 9, "candidates": 30}


@pytest.mark.parametrize(
    ("key", "misspelt", "named"),
    [
        ("\nseed:", "\nsede:", "sede"),
        ("\nfinetuning:", "\nfinetunning:", "finetunning"),
        ("min_count:", "min_cuont:", "graph.min_cuont"),
        ("insert_fraction:", "insert_fration:", "sessions.insert_fration"),
        ("candidates:", "canditates:", "initializers.ers.canditates"),
        ("es:\n    k:", "es:\n    kk:", "initializers.es.kk"),
        ("  ers:\n", "  esr:\n", "initializers.ers"),  # the one that is missing: others may be one's own
    ],
)
def test_a_misspelt_key_is_refused_by_name(tmp_path: Path, key: str, misspelt: str, named: str) -> None:
    assert named in refusal(tmp_path, renamed(key, misspelt))


@pytest.mark.parametrize(
    ("key", "named"), [("typo", "typo"), ("graph.typo", "graph.typo"), ("initializers.es.typo", "initializers.es.typo")]
)
def test_a_key_too_many_is_refused(tmp_path: Path, key: str, named: str) -> None:
    with pytest.raises(InputError, match=rf": {named}: "):
        changed(tmp_path, {key: 1})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("seed", "0"),
        ("seed", -1),
        ("seed", 0.5),
        ("ai2thor.sha256", "5BB9"),
        ("ai2thor.recording", None),
        ("materials.source", "sungc"),
        ("graph.min_count", 0),
        ("words.text", "definitions"),
        ("sessions.seeds", True),
        ("sessions.seeds", 0),
        ("sessions.seeds", 30.0),
        ("sessions.sizes", []),
        ("sessions.sizes", 5),
        ("sessions.sizes", [1, 0]),
        ("sessions.sizes", [1, "2"]),
        ("sessions.sizes", [1, 2, 1]),
        ("sessions.valid", 0.0),
        ("sessions.test", 1.0),
        ("sessions.test", 0.9),  # with 0.1 to validate on, nothing is left to train on
        ("sessions.insert_fraction", 0.0),
        ("sessions.insert_fraction", 1.01),
        ("embedding.dimension", 50),  # halves of 25 make no 2x2 blocks
        ("embedding.init_range", 0),
        ("negatives.mode", "all"),
        ("negatives.ratio", "9"),
        ("negatives.head_pool", "none"),
        ("training.batch_size", 0),
        ("training.learning_rate", "0.1"),
        ("training.learning_rate", -0.1),
        ("training.learning_rate", float("nan")),
        ("training.learning_rate", float("inf")),
        ("training.weight_decay", -1e-3),
        ("training.patience", 0),
        ("finetuning.max_epochs", 0),
        ("convergence.margin", 1),
        ("insert.initializers", []),
        ("insert.initializers", "xavier"),
        ("initializers.xavier", 3),
        ("initializers.rs.k", 0),
        ("initializers.ers.candidates", "30"),
        ("initializers.es_permuted.k", 0),
        ("initializers.gaussian.k", 3),
        ("curves.sizes", 5),
        ("compute.workers", 0),
        ("compute.workers", "every"),
        ("compute.stack", 0),
        ("compute.engine", "threads"),
        ("compute.engine", "dask"),  # and no scheduler
        ("compute.scheduler", "localhost:8786"),
        ("compute.scheduler", "tcp://localhost"),
    ],
)
def test_a_wrong_type_or_a_value_out_of_range_is_refused_by_its_key(tmp_path: Path, key: str, value: object) -> None:
    with pytest.raises(InputError) as refused:
        changed(tmp_path, {key: value})
    line = str(refused.value)
    assert "\n" not in line
    for part in key.split("."):  # a rule between two keys may name their section
        assert part in line.removeprefix(str(tmp_path))


@pytest.mark.parametrize(
    ("key", "value"),
    [("seed", 0), ("sessions.insert_fraction", 1), ("sessions.insert_fraction", 1.0), ("embedding.dimension", 4),
     ("training.weight_decay", 0), ("training.learning_rate", 1), ("compute.workers", 1), ("compute.workers", "all"),
     ("curves.sizes", []), ("words.source", "word2vec-google-news-300"), ("materials.source", "simulator")],
)  # fmt: skip
def test_values_at_the_edge_of_their_range_are_accepted(tmp_path: Path, key: str, value: object) -> None:
    assert changed(tmp_path, {key: value}).pick((key,)) == {key: value}


@pytest.mark.parametrize("key", ["seed", "graph", "graph.min_count", "initializers.ers", "initializers.ers.k"])
def test_a_missing_key_is_refused_by_its_path(tmp_path: Path, key: str) -> None:
    raw = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    *parents, last = key.split(".")
    section = raw
    for parent in parents:
        section = section[parent]
    del section[last]
    assert refusal(tmp_path, yaml.safe_dump(raw)).startswith(f"{key}: ")


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("seed: 0\nai2thor: [\n", "line 3"),
        ("seed: 0\n\tgraph: 1\n", "line 2"),
        (b"seed: \xff\xfe\n", ""),
        ("", "dictionary"),
        ("- seed\n", "dictionary"),
        ("a photograph, not YAML", "dictionary"),
    ],
)
def test_what_is_no_yaml_mapping_is_refused_with_its_line(tmp_path: Path, text: str | bytes, place: str) -> None:
    assert place in refusal(tmp_path, text)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"params\.yaml: cannot be read"):
        load(tmp_path / "params.yaml")


# Initializers of one's own

OWN = {"insert.initializers": ["xavier", "mine"]}


def test_options_of_an_own_initializer_are_taken_when_it_is_inserted(tmp_path: Path) -> None:
    options = {"k": 3, "temperature": 0.5, "metric": "l2", "signed": True}
    params = changed(tmp_path, OWN | {"initializers.mine": options})
    assert params.initializers.options("mine") == options
    assert params.pick(("initializers.mine", "initializers.mine.k")) == {
        "initializers.mine": options,
        "initializers.mine.k": 3,
    }


def test_an_own_initializer_needs_an_entry_that_may_be_empty(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"initializers\.mine: expected its options"):
        changed(tmp_path, OWN)
    assert changed(tmp_path, OWN | {"initializers.mine": {}}).initializers.options("mine") == {}


def test_options_of_an_own_initializer_are_refused_when_it_is_not_inserted(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"initializers\.mine.*insert\.initializers"):
        changed(tmp_path, {"initializers.mine": {"k": 3}})


def test_options_of_the_papers_initializers_stay_checked_beside_an_own_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"initializers\.es\.typo"):
        changed(tmp_path, OWN | {"initializers.mine": {"k": 3}, "initializers.es.typo": 3})


@pytest.mark.parametrize("options", [{"k": [1, 2]}, {"k": None}, {"k": {"a": 1}}, 3])
def test_options_that_are_no_scalars_are_refused(tmp_path: Path, options: object) -> None:
    with pytest.raises(InputError, match=r"params\.yaml: initializers\.mine"):
        changed(tmp_path, OWN | {"initializers.mine": options})


# Picking


def test_pick_gives_values_at_dotted_keys_sections_whole_and_null_for_the_absent() -> None:
    params = load(paths.PARAMS)
    assert params.pick(("sessions.seeds", "initializers.ers", "initializers.nobody", "graph.min_count.deeper")) == {
        "sessions.seeds": 30,
        "initializers.ers": {"k": 9, "candidates": 30},
        "initializers.nobody": None,
        "graph.min_count.deeper": None,
    }


def test_params_cannot_be_changed_after_they_were_checked() -> None:
    with pytest.raises(ValueError, match="frozen"):
        load(paths.PARAMS).graph.min_count = 2
