"""``isi import``: an imported model gives the scores of the original,
and no code of a pickle runs.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from isi.graph.graph import HEAD, TAIL
from tests.importing import Bomb, imported
from tests.small_bundle import (
    BETWEEN,
    ENTITIES,
    LABELS,
    NAMES,
    TRIPLES,
    write_lists,
)

pytestmark = pytest.mark.usefixtures("in_tmp_path")


# Arrays and ids


def save_npy(folder: Path) -> None:
    np.save(folder / "entities.npy", ENTITIES)
    np.save(folder / "relations.npy", LABELS)


FORMS: dict[str, Callable[[Path], object]] = {
    "npy": save_npy,
    "npz": lambda folder: np.savez(folder / "tables.npz", entities=ENTITIES, relations=LABELS),
    "safetensors": lambda folder: save_file(
        {"entities": ENTITIES, "relations": LABELS}, folder / "t.safetensors"
    ),
    "state dict": lambda folder: torch.save(
        {"entities": torch.from_numpy(ENTITIES), "relations": torch.from_numpy(LABELS)},
        folder / "t.pt",
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_tables_come_from_any_form(form: str, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_lists()
    FORMS[form](folder)
    bundle = imported(str(folder), "--model", "distmult")
    assert bundle.entities.tobytes() == ENTITIES.tobytes()
    assert bundle.relations.tobytes() == LABELS.tobytes()
    assert (bundle.entity_names, bundle.relation_names) == (NAMES, BETWEEN)
    assert sorted(map(tuple, bundle.triples.tolist())) == sorted(TRIPLES)
    assert (
        capsys.readouterr().out
        == "6 entities, 2 relations, 4 triples; distmult of dimension 4: out\n"
    )


def test_names_may_begin_with_a_mark_and_there_may_be_no_triples() -> None:
    folder = write_lists(entities=ENTITIES, relations=LABELS)
    (folder / "entities.txt").write_text("\n".join(NAMES), encoding="utf-8-sig")
    (folder / "triples.tsv").write_bytes(b"")
    bundle = imported("mine", "--model", "distmult")
    assert bundle.entity_names == NAMES
    assert bundle.triples.shape == (0, 3)


def test_complex_numbers_are_parted() -> None:
    whole = {"entities": ENTITIES + 1j * (ENTITIES + 1), "relations": LABELS + 1j * (LABELS + 1)}
    parted = imported(str(write_lists(**whole)), "--model", "complex")
    assert parted.entities.tolist() == np.concatenate([ENTITIES, ENTITIES + 1], 1).tolist()
    assert parted.relations.tolist() == np.concatenate([LABELS, LABELS + 1], 1).tolist()


def test_rotations_become_angles() -> None:
    angles = np.array([[0.1, -2.0, 3.0, 0.0], [1.0, 2.0, -3.0, 0.5]])
    given = {"entities": ENTITIES + 1j * ENTITIES, "relations": np.exp(1j * angles)}
    bundle = imported(
        str(write_lists(**given)),
        "--model",
        "rotate",
        "--set",
        "margin=4",
        "--set",
        "squared=true",
    )
    np.testing.assert_allclose(bundle.relations, angles, rtol=1e-6)
    assert bundle.manifest.model_options == {"margin": 4.0, "squared": True}


def test_a_margin_lies_halfway_between_triples_and_corrupted_ones() -> None:
    """TransE in one dimension with one relation: for true triples the tail is at head + 1."""
    folder = write_lists()
    (folder / "triples.tsv").write_text(
        "kitchen\tatLocation\tbedroom\nkettle\tatLocation\tbed\n", encoding="utf-8"
    )
    np.savez(
        folder / "t.npz",
        entities=np.array([[0.0], [1.0], [5.0], [6.0], [9.0], [9.0]]),
        relations=np.ones((2, 1)),
    )
    model = imported(str(folder), "--model", "transe_l1").model
    # distances are 0; 5 with the other head or tail
    assert model.margin == pytest.approx(2.5)  # type: ignore[attr-defined]


STATE = {"entities": torch.from_numpy(ENTITIES), "relations": torch.from_numpy(LABELS)}


@pytest.mark.parametrize(
    ("files", "named"),
    [
        ({"t.pt": {"entities": STATE["entities"]}}, "one tensor relations .* got none"),
        ({"t.pt": {"model": STATE}}, "one tensor entities .* got none"),
        ({"best.pt": STATE, "last.pt": STATE}, r"one tensor entities .* got best\.pt, last\.pt"),
    ],
)
def test_a_table_that_is_missing_or_there_twice_is_refused(
    files: dict[str, Any], named: str
) -> None:
    folder = write_lists()
    for name, state in files.items():
        torch.save(state, folder / name)
    with pytest.raises(SystemExit, match=named):
        imported(str(folder), "--model", "distmult")
    assert not Path("out").exists()


def test_tables_of_two_files_may_share_other_tensors() -> None:
    folder = write_lists()
    for name, values in STATE.items():
        torch.save({name: values, "pi": torch.ones(1)}, folder / f"{name[:3]}.pt")
    assert imported(str(folder), "--model", "distmult").relations.tobytes() == LABELS.tobytes()


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Any, Path]]:
    """A PyKEEN model after one epoch, and the folder in which PyKEEN's pipeline saved it."""
    pytest.importorskip("pykeen", reason="the extra `pykeen` is not installed")
    from pykeen.pipeline import pipeline

    done: dict[str, tuple[Any, Path]] = {}
    kinds = {
        "TransE squared": ("TransE", {"scoring_fct_norm": 2, "power_norm": True}),
        "TransE L1": ("TransE", {"scoring_fct_norm": 1}),
    }

    def train(name: str) -> tuple[Any, Path]:
        if name not in done:
            model, options = kinds.get(name, (name, {}))
            result = pipeline(
                dataset="nations",
                model=model,
                model_kwargs={"embedding_dim": 6, **options},
                random_seed=0,
                training_kwargs={"num_epochs": 1, "use_tqdm": False},
                evaluation_kwargs={"use_tqdm": False},
                device="cpu",
            )
            folder = tmp_path_factory.mktemp("pykeen")
            result.save_to_directory(folder)
            torch.save(result.model.state_dict(), folder / "state.pt")
            done[name] = (result.model, folder)
        return done[name]

    return train


MODELS = {
    "DistMult": ["distmult", "--set", "constraint=sphere"],
    "ComplEx": ["complex"],
    "RotatE": ["rotate"],
    "TransE L1": ["transe_l1", "--set", "constraint=sphere"],
    "TransE squared": ["transe", "--set", "squared=true", "--set", "constraint=sphere"],
}


@pytest.mark.parametrize("name", MODELS)
def test_a_model_of_pykeen_scores_the_same_by_its_state_dict(
    saved: Callable[[str], tuple[Any, Path]], name: str
) -> None:
    model, folder = saved(name)
    by_state = imported(str(folder), "--model", *MODELS[name])
    assert by_state.entity_names[0] == "brazil"
    assert len(by_state.triples) == 1592
    margin = getattr(by_state.model, "margin", 0.0)
    for slot, theirs in ((TAIL, model.score_t), (HEAD, model.score_h)):
        given = torch.tensor([0, 3, 13])
        pairs = [given, torch.full_like(given, 7)]
        with torch.no_grad():
            expected = theirs(torch.stack(pairs if slot == TAIL else pairs[::-1], 1)).numpy()
        ours = by_state.scores.tails if slot == TAIL else by_state.scores.heads
        scores = ours(given.numpy(), 7) - margin
        np.testing.assert_allclose(scores, expected, rtol=1e-4, atol=1e-4)


def test_inverse_triples_of_a_state_dict_are_named(tmp_path: Path) -> None:
    pytest.importorskip("pykeen", reason="the extra `pykeen` is not installed")
    from pykeen.models import DistMult
    from pykeen.triples import TriplesFactory

    rows = np.array(
        [[NAMES[head], BETWEEN[relation], NAMES[tail]] for head, relation, tail in TRIPLES]
    )
    factory = TriplesFactory.from_labeled_triples(rows, create_inverse_triples=True)
    model = DistMult(triples_factory=factory, embedding_dim=4)
    factory.to_path_binary(tmp_path / "training_triples")
    torch.save(model.state_dict(), tmp_path / "state.pt")
    with pytest.raises(SystemExit, match=r"inverse triples.*isi\.pykeen\.insert"):
        imported(str(tmp_path), "--model", "distmult")


def test_no_code_of_a_pickle_runs() -> None:
    torch.save(Bomb(), write_lists() / "state.pt")
    with pytest.raises(SystemExit, match="other pickles are not read"):
        imported("mine", "--model", "distmult")
    assert not Path("exploded").exists()
