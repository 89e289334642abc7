"""The code and the commands of pages of docs/ run as they stand, and the layouts of
docs/you-have.md score as the other libraries do.

LibKGE, OpenKE, PyTorch-BigGraph, dicee and AmpliGraph are not installed: the tests write their
formats, and have their formulas.
"""

import json
import re
import shlex
import shutil
import sys
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

import isi
from isi.__main__ import main
from isi.graph.files import read_graph
from tests import their_scores
from tests.documented import DOCS
from tests.small_bundle import (
    BETWEEN,
    ENTITIES,
    LABELS,
    NAMES,
    RELATIONS,
    TRIPLES,
    VECTORS,
    home_of,
    without_words,
    write_lists,
    write_openke,
)

FIRST, *RECIPES = (DOCS / "you-have.md").read_text(encoding="utf-8").split("\n## ")
#: The recipes by heading, and the other pages by name.
TEXTS = dict(recipe.split("\n", 1) for recipe in RECIPES) | {
    name: (DOCS / f"{name}.md").read_text(encoding="utf-8")
    for name in ("command", "insert", "live")
}
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.DOTALL | re.MULTILINE)
NEEDS = {
    "PyTorch-BigGraph": ["h5py"],
    "insert": ["pykeen"],
    "PyKEEN": ["pykeen"],
    "TorchKGE": ["torchkge"],
}


class AmpliGraphModel:
    """``get_embeddings`` of AmpliGraph's ScoringBasedEmbeddingModel."""

    def get_embeddings(self, entities: Any, embedding_type: str = "e") -> np.ndarray:
        names, rows = (NAMES, ENTITIES) if embedding_type == "e" else (BETWEEN, LABELS)
        return rows[[names.index(name) for name in entities]]


def write_checkpoints() -> None:
    """The folder and a checkpoint of OpenKE."""
    write_openke(Path("mine"))
    state = {
        "ent_embeddings.weight": torch.tensor(ENTITIES),
        "rel_embeddings.weight": torch.tensor(LABELS),
    }
    constants = {"zero_const": torch.zeros(1), "pi_const": torch.tensor([torch.pi])}
    torch.save(constants | state, "distmult.ckpt")


def write_biggraph() -> None:
    """A checkpoint of PyTorch-BigGraph, with the names of its preprocessing."""
    import h5py

    Path("mine").mkdir()
    Path("mine/entity_names_all_0.json").write_text(json.dumps(NAMES), encoding="utf-8")
    Path("mine/dynamic_rel_names.json").write_text(json.dumps(BETWEEN), encoding="utf-8")
    with h5py.File("mine/embeddings_all_0.v3.h5", "w") as file:
        file.create_dataset("embeddings", data=ENTITIES)
    with h5py.File("mine/model.v3.h5", "w") as file:
        for side, sign in (("lhs", 1), ("rhs", -1)):
            of_side = f"model/relations/0/operator/{side}/diagonals"
            file.create_dataset(of_side, data=sign * LABELS)


def write_dicee() -> None:
    """The folder of an experiment of dicee."""
    Path("mine").mkdir()
    for slot, names in (("entity", NAMES), ("relation", BETWEEN)):
        rows = [f",{slot}", *(f"{place},{name}" for place, name in enumerate(names)), ""]
        Path(f"mine/{slot}_to_idx.csv").write_text("\n".join(rows), encoding="utf-8")
    np.save("mine/train_set.npy", np.array(TRIPLES, np.int8))
    state = {
        "entity_embeddings.weight": torch.from_numpy(ENTITIES),
        "relation_embeddings.weight": torch.from_numpy(LABELS),
    }
    torch.save(OrderedDict(state), "mine/model.pt")


def write_libkge(relations: np.ndarray = LABELS) -> None:
    """The files of LibKGE's preprocessing, and a checkpoint:
    a pickled ``Config`` beside (state dict, meta).
    """
    Path("mine").mkdir()
    for slot, names in (("entity", NAMES), ("relation", BETWEEN)):
        lines = "".join(f"{number}\t{name}\n" for number, name in enumerate(names))
        Path("mine", f"{slot}_ids.del").write_text(lines, encoding="utf-8")
    Path("mine/train.del").write_text(
        "".join("\t".join(map(str, row)) + "\n" for row in TRIPLES), encoding="utf-8"
    )
    config = type("Config", (), {"__module__": "kge.config"})()
    vars(config).update(folder="local", options={"model": "complex"})
    module: Any = ModuleType("kge.config")
    module.Config = type(config)
    state = {
        "_entity_embedder._embeddings.weight": torch.tensor(ENTITIES),
        "_relation_embedder._embeddings.weight": torch.tensor(relations),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "kge", ModuleType("kge"))
        patch.setitem(sys.modules, "kge.config", module)
        torch.save(
            {"type": "train", "epoch": 3, "model": (state, {}), "config": config},
            "checkpoint_best.pt",
        )


def write_tables() -> None:
    """A table of triples, with kinds, and the tables of another trainer."""
    for path in (DOCS.parent / "examples").glob("home*.csv"):
        shutil.copy(path, ".")
    write_lists(entities=np.array(VECTORS, float), relations=np.array(RELATIONS, float))


def write_home() -> None:
    home_of(Path("home"), without_words())


PREPARE: dict[str, Callable[[], None]] = {
    "PyTorch-BigGraph": write_biggraph,
    "command": write_tables,
    "dicee": write_dicee,
    "live": write_home,
    "OpenKE": write_checkpoints,
    "LibKGE": write_libkge,
}


def run(name: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """Run the code and the commands of a recipe or page in order;
    the names that the code defines.
    """
    scope: dict[str, Any] = {"__name__": "page"}
    text = TEXTS[name]
    if name == "AmpliGraph 2":
        scope |= {
            "model": AmpliGraphModel(),
            "X": np.array([[NAMES[h], BETWEEN[r], NAMES[t]] for h, r, t in TRIPLES]),
        }
    if "write(" in text:
        function, then = FIRST.split("After the import", 1)
        text = function + text + then
    for language, code in BLOCK.findall(text):
        if language == "python":
            exec(compile(code, name, "exec"), scope)  # noqa: S102
        elif language == "console":
            for line in re.findall(r"^\$ isi (.+)$", code, re.MULTILINE):
                main(shlex.split(line))
                assert capsys.readouterr().out
    return scope


@pytest.mark.filterwarnings("ignore:the model has learned nothing")
@pytest.mark.parametrize("name", TEXTS)
def test_a_page_runs_as_it_stands(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for package in NEEDS.get(name, ()):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    PREPARE.get(name, lambda: None)()
    scope = run(name, capsys)
    if name == "insert":
        assert scope["done"].entities[:5].tobytes() == scope["entities"].tobytes()
        assert scope["with_relation"].entity_names[-1] == "lamp"
    elif name == "live":
        assert scope["answers"].answers[0].given
        (known,) = scope["known"]
        assert known.fact == ("espresso machine", "atLocation", "kitchen")
        read, _ = read_graph([Path("facts.csv")])
        assert len(read.triples) == len(scope["facts"]) == scope["summary"].triples
    elif name == "command":
        assert Path("home").is_dir()
    elif name == "PyKEEN":
        before = scope["result"].training.num_entities
        assert scope["larger"].num_entities == scope["more"].num_entities == before + 1
        assert scope["trained"].num_entities == scope["factory"].num_entities == before + 1
        assert len(scope["losses"]) == 2
    elif "done" in scope:
        done = scope["done"]
        assert done.entity_names[-1] == "espresso machine"
        assert done.details.new == [len(done.entities) - 1]
    else:
        larger = isi.open("imported").now
        assert larger.entity_names[-1] == "espresso machine"
        rows = [larger.names.ids[name] for name in NAMES]
        assert larger.entities[rows].tobytes() == ENTITIES.tobytes()
        assert larger.relations[:2].tobytes() == LABELS.tobytes()
        assert larger.relation_names[:2] == BETWEEN
        if name == "PyTorch-BigGraph":
            assert larger.relation_names[2:] == [f"{name}_inverse" for name in BETWEEN]
            assert larger.relations[2:].tobytes() == (-LABELS).tobytes()
        else:
            assert len(larger.triples) == len(TRIPLES) + 1


def test_reciprocal_relations_of_libkge_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_libkge(np.concatenate([LABELS, LABELS]))
    with pytest.raises(SystemExit, match="twice as many"):
        run("LibKGE", capsys)


@pytest.mark.parametrize(
    ("theirs", "model"),
    [
        (their_scores.complex_of_libkge, "complex"),
        (their_scores.rotate_of_libkge, "rotate"),
        (their_scores.complex_of_openke, "complex"),
        (their_scores.complex_of_ampligraph, "complex"),
        (their_scores.hole_of_ampligraph, "complex"),
        (their_scores.transe_of_openke, "transe"),
        (their_scores.transe_of_dicee, "transe"),
    ],
)
def test_tables_score_as_in_the_other_library(theirs: Callable[..., Tensor], model: str) -> None:
    """Up to the margin, after what the page does to the tables."""
    torch.manual_seed(0)
    entities, relations = torch.randn(7, 6), torch.randn(3, 3 if model == "rotate" else 6)
    used = entities, relations
    if theirs is their_scores.hole_of_ampligraph:
        used = entities, relations * (2 / 3)
    if theirs is their_scores.transe_of_openke:
        used = normalize(entities), normalize(relations)
    options = {} if model == "complex" else {"margin": 2.0}
    done = isi.insert(
        *(table.numpy() for table in used),
        [(7, 0, 1)],
        new=1,
        model=model,
        model_options=options,
        initializer="mean",
    )
    head, relation, tail = torch.cartesian_prod(torch.arange(7), torch.arange(3), torch.arange(7)).T
    ours = done.details.embedding.score(head[None], relation[None], tail[None])[0] - options.get(
        "margin", 0.0
    )
    torch.testing.assert_close(
        ours, theirs(entities[head], relations[relation], entities[tail]), rtol=1e-4, atol=1e-5
    )
