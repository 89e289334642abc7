"""``isi import`` of folders that PyTorch-BigGraph and dicee write: the imported model has the
trainer's scores, and no model is read whose scores it cannot have.
"""

import json
import sys
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch
import yaml

from isi.errors import MissingPackage
from isi.graph.graph import TAIL
from isi.live import checkpoints
from isi.live.checkpoints import INVERSE
from isi.live.loaded import LoadedEmbedding
from tests.importing import Bomb, imported
from tests.small_bundle import BETWEEN, NAMES
from tests.their_scores import complex_of_openke, distmult_of_dicee, transe_of_dicee

pytestmark = pytest.mark.usefixtures("in_tmp_path")
R = len(BETWEEN)
DIMENSION = 4


def scores(bundle: LoadedEmbedding, relation: str) -> np.ndarray:
    """Scores of all heads and tails, without a margin; shape (E, E)."""
    given = torch.arange(len(bundle.entity_names))
    rows = bundle.scores(given, bundle.relation_names.index(relation), TAIL).numpy()
    return np.asarray(rows - getattr(bundle.model, "margin", 0.0))


def random(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(shape).astype(np.float32)


# PyTorch-BigGraph


def save(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write an HDF5 file as PyTorch-BigGraph does."""
    with h5py.File(path, "w") as file:
        file.attrs["format_version"] = 1
        for name, array in arrays.items():
            file.create_dataset(name, data=array)
        state = np.frombuffer(b"a state dict of the optimizer", np.dtype("V1"))
        file.create_dataset("optimizer/state_dict", data=state)


def configured(**changed: Any) -> dict[str, Any]:
    """The content of ``config.json``: the keys that a reader needs, and some others."""
    config = {
        "entities": {"all": {"num_partitions": 2, "featurized": False, "dimension": None}},
        "relations": [
            {"name": name, "lhs": "all", "rhs": "all", "operator": "diagonal", "all_negs": False}
            for name in BETWEEN
        ],
        "dimension": DIMENSION,
        "max_norm": None,
        "global_emb": False,
        "comparator": "dot",
        "bias": False,
        "loss_fn": "softmax",
        "dynamic_relations": False,
        "bucket_order": "inside_out",
        "entity_path": "data",
    }
    return config | changed


def write_biggraph(
    config: dict[str, Any],
    model: dict[str, np.ndarray],
    vectors: np.ndarray | None = None,
) -> np.ndarray:
    """Write the folder ``pbg``, of checkpoint 3, with six entities in two partitions.
    Returns their vectors.
    """
    folder = Path("pbg")
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps(config, indent=4), encoding="utf-8")
    (folder / "checkpoint_version.txt").write_text("3\n", encoding="utf-8")
    names = json.dumps(BETWEEN, indent=4)
    (folder / "dynamic_rel_names.json").write_text(names, encoding="utf-8")
    vectors = random(6, config["dimension"]) if vectors is None else vectors
    parts = [
        (kind, part)
        for kind, settings in config["entities"].items()
        for part in range(settings["num_partitions"])
    ]
    for (kind, part), rows in zip(parts, (slice(0, 4), slice(4, 6)), strict=True):
        path = folder / f"entity_names_{kind}_{part}.json"
        path.write_text(json.dumps(NAMES[rows], indent=4), encoding="utf-8")
        save(folder / f"embeddings_{kind}_{part}.v3.h5", {"embeddings": vectors[rows]})
    save(folder / "model.v3.h5", {f"model/{name}": array for name, array in model.items()})
    return vectors


def operated(operator: str, vector: np.ndarray, parameters: dict[str, np.ndarray]) -> np.ndarray:
    """PyTorch-BigGraph's operators."""
    mapped = vector
    if operator == "diagonal":
        mapped = parameters["diagonal"] * vector
    if operator == "translation":
        mapped = vector + parameters["translation"]
    if operator == "complex_diagonal":
        a, b = np.split(vector, 2)
        real, imag = parameters["real"], parameters["imag"]
        mapped = np.concatenate([a * real - b * imag, a * imag + b * real])
    return mapped


def compared(comparator: str, left: np.ndarray, right: np.ndarray) -> float:
    """PyTorch-BigGraph's comparators."""
    distance = float(np.square(left - right).sum())
    if comparator == "dot":
        return float(left @ right)
    return -(distance**0.5) if comparator == "l2" else -distance


def assert_equal(actual: np.ndarray, expected: list[list[float]], comparator: str) -> None:
    """Equal up to rounding; ``Distance`` takes no root of less than 1e-6."""
    least = 1.1e-3 if comparator == "l2" else 1e-5
    np.testing.assert_allclose(actual, expected, rtol=1e-4, atol=least)


WIDTHS: dict[str, dict[str, int]] = {
    "none": {},
    "diagonal": {"diagonal": DIMENSION},
    "translation": {"translation": DIMENSION},
    "complex_diagonal": {"real": DIMENSION // 2, "imag": DIMENSION // 2},
}
PLURAL = {"diagonal": "diagonals", "translation": "translations"}  #: of dynamic relations
EQUAL = [*checkpoints.SCORES.items()]
#: Diagonals of ones, by the trainer's names.
ONES = {f"relations/{place}/operator/rhs/diagonal": np.ones(DIMENSION, "f4") for place in range(R)}


def margin(model: str) -> list[str]:
    return ["--set", "margin=2"] if model == "transe" else []


@pytest.mark.parametrize("is_dynamic", [False, True], ids=["", "dynamic"])
@pytest.mark.parametrize(("score", "model"), EQUAL, ids=[" ".join(score) for score, _ in EQUAL])
def test_a_relation_of_biggraph_scores_the_same_and_a_dynamic_one_has_an_inverse_for_heads(
    score: tuple[str, str], model: str, is_dynamic: bool
) -> None:
    operator, comparator = score
    sides = {"lhs": "", "rhs": INVERSE} if is_dynamic else {"rhs": ""}
    names = ["all_edges"] if is_dynamic else BETWEEN
    relations = [{"name": name, "operator": operator} for name in names]
    config = configured(comparator=comparator, relations=relations, dynamic_relations=is_dynamic)
    parameters, stored = dict[str, dict[str, np.ndarray]](), dict[str, np.ndarray]()
    for seed, side in enumerate(sides):
        parameters[side] = {}
        for name, width in WIDTHS[operator].items():
            rows = parameters[side][name] = random(R, width, seed=10 * seed + len(name))
            if is_dynamic:
                stored[f"relations/0/operator/{side}/{PLURAL.get(name, name)}"] = rows
            else:
                for place, row in enumerate(rows):
                    stored[f"relations/{place}/operator/{side}/{name}"] = row
    vectors = write_biggraph(config, stored)
    fact = ("kettle", "hasAffordance", "turn on")
    Path("pbg/triples.tsv").write_text("\t".join(fact) + "\n", encoding="utf-8")
    bundle = imported("pbg", *margin(model))
    assert bundle.manifest.model_name == model
    assert bundle.entity_names == NAMES
    assert bundle.relation_names == [name + end for name in BETWEEN for end in sides.values()]
    inverse = [("turn on", f"hasAffordance{INVERSE}", "kettle")]
    assert bundle.named_triples() == [fact, *inverse * is_dynamic]
    assert bundle.entities.tobytes() == vectors.tobytes()
    for place, relation in enumerate(BETWEEN):
        for side, end in sides.items():
            given = {name: rows[place] for name, rows in parameters[side].items()}
            mapped = np.stack([operated(operator, vector, given) for vector in vectors])
            ends = (mapped, vectors) if is_dynamic else (vectors, mapped)
            expected = [[compared(comparator, x, y) for y in ends[1]] for x in ends[0]]
            assert_equal(scores(bundle, relation + end), expected, comparator)


def test_types_limits_and_shared_vectors_of_biggraph() -> None:
    """Of two types, with one partition each: a vector of length 5 becomes one of length 2.5, and
    each type has its own shared vector.
    """
    kinds = {kind: {"num_partitions": 1, "featurized": False} for kind in ("thing", "action")}
    config = configured(dimension=2, entities=kinds, max_norm=2.5, global_emb=True)
    vectors = np.array([[3, 4], *[[1, 0]] * 5], np.float32)
    stored = {f"relations/{place}/operator/rhs/diagonal": np.ones(2, "f4") for place in range(R)}
    stored["entities/thing/global_embedding"] = np.array([10, 20], "f4")
    stored["entities/action/global_embedding"] = np.array([0, -1], "f4")
    write_biggraph(config, stored, vectors)
    bundle = imported("pbg")
    expected = np.array([[11.5, 22], *[[11, 20]] * 3, *[[1, -1]] * 2])
    np.testing.assert_allclose(bundle.entities, expected, rtol=1e-6)
    assert bundle.kinds == ["thing"] * 4 + ["action"] * 2


@pytest.mark.parametrize(
    ("changed", "loss"),
    [
        ({"loss_fn": "softmax"}, "softmax"),
        ({"loss_fn": "logistic"}, "logistic"),
        ({"loss_fn": "ranking"}, "margin"),
        ({"loss_fn": "of my own"}, None),
    ],
)
def test_the_loss_of_biggraph_is_stored(changed: dict[str, str], loss: str | None) -> None:
    write_biggraph(configured(**changed), ONES)
    assert imported("pbg").manifest.trained_with == loss
    assert imported("pbg", "--loss", "margin").manifest.trained_with == "margin"


def test_a_missing_package_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingPackage, match=r"isi-kge\[hdf5\]"):
        checkpoints.read_hdf5(Path("model.v1.h5"), "model")


# dicee


def write_dicee(
    model: str,
    folder: str = "dicee",
    header: str = "",
    further: dict[str, torch.Tensor] | None = None,
    changed: dict[str, Any] | None = None,
) -> dict[str, torch.Tensor]:
    """Write the folder of an experiment; returns the state dict of its model."""
    path = Path(folder)
    path.mkdir()
    config = {"model": model, "optim": "Adam", "embedding_dim": DIMENSION, "p": 0, "q": 1}
    config |= {"scoring_technique": "NegSample", "normalization": None, "loss_fn": "BCELoss"}
    text = json.dumps(config | (changed or {}), indent=3)
    (path / "configuration.json").write_text(text, encoding="utf-8")
    for slot, names in (("entity", NAMES), ("relation", BETWEEN)):
        rows = [f"{header},{slot}", *(f"{place},{name}" for place, name in enumerate(names))]
        (path / f"{slot}_to_idx.csv").write_text("\n".join([*rows, ""]), encoding="utf-8")
    np.save(path / "train_set.npy", np.array([[2, 0, 0], [2, 1, 4]], np.int8))
    state = {
        "entity_embeddings.weight": torch.from_numpy(random(6, DIMENSION)),
        "relation_embeddings.weight": torch.from_numpy(random(R, DIMENSION, seed=1)),
    }
    torch.save(OrderedDict(state | (further or {})), path / "model.pt")
    return state


#: dicee's scores by model, and the options of the algebra.
DICEE: list[tuple[str, dict[str, int | None], str, Callable[..., torch.Tensor]]] = [
    ("DistMult", {}, "distmult", distmult_of_dicee),
    ("Keci", {"p": 0, "q": 0}, "distmult", distmult_of_dicee),
    ("CMult", {"p": None, "q": None}, "distmult", distmult_of_dicee),
    ("ComplEx", {}, "complex", complex_of_openke),
    ("CMult", {"p": 0, "q": 1}, "complex", complex_of_openke),
    ("TransE", {}, "transe", transe_of_dicee),
]


@pytest.mark.parametrize(("name", "algebra", "model", "score"), DICEE)
@pytest.mark.parametrize("header", ["", "index"], ids=["pandas", "polars"])
def test_a_model_of_dicee_scores_the_same(
    name: str, algebra: dict[str, int | None], model: str, score: Callable[..., Any], header: str
) -> None:
    vectors, relations = write_dicee(name, header=header, changed=algebra).values()
    bundle = imported("dicee")
    assert bundle.manifest.model_name == model
    assert bundle.manifest.trained_with == "logistic"
    assert (bundle.entity_names, bundle.relation_names) == (NAMES, BETWEEN)
    assert sorted(bundle.named_triples()) == [
        ("kettle", "atLocation", "kitchen"),
        ("kettle", "hasAffordance", "turn on"),
    ]
    given = torch.arange(6)
    for place in range(R):
        expected = score(vectors[:, None], relations[place], vectors[None])
        torch.testing.assert_close(bundle.scores(given, place, TAIL), expected)


@pytest.mark.parametrize(
    "changed", [{"loss_fn": "LRLoss"}, {"adversarial_temperature": 1.0}], ids=str
)
def test_another_loss_of_dicee_is_unknown(changed: dict[str, Any]) -> None:
    write_dicee("DistMult", changed=changed)
    assert imported("dicee").manifest.trained_with is None
    assert imported("dicee", "--loss", "softmax").manifest.trained_with == "softmax"


def test_normalization_of_dicee_is_refused() -> None:
    weight = {"normalize_head_entity_embeddings.weight": torch.ones(DIMENSION)}
    write_dicee("DistMult", further=weight, changed={"normalization": "LayerNorm"})
    with pytest.raises(SystemExit, match=r"model\.pt: .*alone, got .*normalize_head"):
        imported("dicee")


def test_no_pickle_of_dicee_is_read() -> None:
    write_dicee("DistMult")
    table = Path("dicee/entity_to_idx.csv")
    table.unlink()
    torch.save(Bomb(), table.with_suffix(".p"))
    with pytest.raises(
        SystemExit, match=r"entity_to_idx\.p: a pickle .*to_csv\('entity_to_idx\.csv"
    ):
        imported("dicee")
    write_dicee("DistMult", "other")
    torch.save(Bomb(), "other/model.pt")
    with pytest.raises(SystemExit, match=r"other/model\.pt: "):
        imported("other")
    assert not Path("exploded").exists()


# Folders of both that are refused

CASES = yaml.safe_load((Path(__file__).parent / "checkpoints.yaml").read_text(encoding="utf-8"))


def change(path: Path, content: Any) -> None:
    """Replace a file of a folder; ``checkpoints.yaml`` says by what."""
    path.unlink()
    if path.suffix == ".h5":
        save(path, {name: np.array(rows, np.float32) for name, rows in content.items()})
    elif path.suffix == ".npy":
        np.save(path, np.array(content))
    elif content is not None:
        path.write_text(content, encoding="utf-8")


@pytest.mark.parametrize(
    ("folder", "case"),
    [
        pytest.param(folder, case, id=f"{folder}: {case['says']}")
        for folder, of_folder in CASES.items()
        for case in of_folder
    ],
)
def test_a_folder_of_another_model_or_with_a_broken_file_is_refused(
    folder: str, case: dict[str, Any]
) -> None:
    changed = case.get("config", {})
    if folder == "pbg":
        write_biggraph(configured(), ONES)
        Path("pbg/config.json").write_text(json.dumps(configured(**changed)), encoding="utf-8")
    else:
        write_dicee("DistMult", changed=changed)
    for name, content in case.get("files", {}).items():
        change(Path(folder, name), content)
    with pytest.raises(SystemExit) as ended:
        imported(folder, *case.get("arguments", []))
    missing = [words for words in case["says"].split("|") if words not in str(ended.value.code)]
    assert not missing, ended.value.code
    assert not Path("out").exists()


def test_a_folder_may_have_no_triples() -> None:
    write_dicee("DistMult")
    Path("dicee/train_set.npy").unlink()
    assert imported("dicee").triples.shape == (0, 3)
