"""``isi import``: an imported model gives the scores of the original,
and no pickle is loaded without consent.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from safetensors.torch import save_file as save_tensors

from isi.__main__ import main
from isi.graph.graph import HEAD, TAIL
from tests.importing import Bomb, imported
from tests.small_bundle import (
    BETWEEN,
    ENTITIES,
    LABELS,
    NAMES,
    TRIPLES,
    write_lists,
    write_openke,
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


@pytest.mark.parametrize("source", [write_lists, write_openke])
@pytest.mark.parametrize("form", FORMS)
def test_tables_come_from_any_form(
    form: str, source: Callable[[], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = source()
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


OF_OPENKE = {
    "ent_embeddings.weight": STATE["entities"],
    "rel_embeddings.weight": STATE["relations"],
}
ADAM = {"state": {0: {"exp_avg": STATE["entities"]}, 1: {"exp_avg": STATE["relations"]}}}


def prefixed(prefix: str) -> dict[str, torch.Tensor]:
    return {prefix + name: values for name, values in OF_OPENKE.items()}


CHECKPOINTS: dict[str, Any] = {
    "other tensors": {**OF_OPENKE, "zero_const": torch.zeros(1), "ids": torch.zeros(6, 2).int()},
    "parallel": prefixed("module."),
    "compiled": prefixed("_orig_mod.model."),
    "nested": {"epoch": 3, "model_state_dict": OF_OPENKE, "optimizer_state_dict": ADAM},
    "Lightning": {"state_dict": prefixed("model."), "optimizer_states": [ADAM], "loops": {}},
    "deep": {"model": [{"state_dict": OF_OPENKE}, {}], "optimizer": ADAM},
}


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_the_tables_of_any_trainer_are_those_with_a_row_for_each_name(name: str) -> None:
    torch.save(CHECKPOINTS[name], write_openke() / "c.ckpt")
    bundle = imported("theirs", "--model", "distmult")
    assert bundle.entities.tobytes() == ENTITIES.tobytes()
    assert bundle.relations.tobytes() == LABELS.tobytes()


@pytest.mark.parametrize(
    ("state", "named"),
    [
        (
            {"ent_emb.weight": torch.zeros(5, 4)},
            r"entities.*--entities NAME.*ent_emb.weight \(5 x 4\)",
        ),
        ({"entities": STATE["entities"]}, "relations.*--relations NAME.*no tensor"),
        ({"epoch": 3}, "no tensor"),
        ({**OF_OPENKE, "transfer": STATE["relations"]}, r"rel_embeddings.*transfer \(2 x 4\)"),
        ({**OF_OPENKE, "average": OF_OPENKE}, "ent_embeddings.weight.*average.ent_embeddings"),
    ],
)
def test_tensors_that_do_not_fit_or_not_alone_are_listed(state: dict[str, Any], named: str) -> None:
    folder = write_lists()
    torch.save(state, folder / "t.pt")
    with pytest.raises(SystemExit, match=f"expected one tensor .*{named}"):
        imported(str(folder), "--model", "distmult")


def test_tensors_are_named_by_options() -> None:
    """There are as many relations as entities."""
    folder = write_lists()
    (folder / "relations.txt").write_text("".join(f"r{name}\n" for name in NAMES), "utf-8")
    (folder / "triples.tsv").unlink()
    torch.save({"a.weight": STATE["entities"] * 2, "b": STATE["entities"]}, folder / "t.pt")
    typed = [str(folder), "--model", "distmult"]
    with pytest.raises(SystemExit, match=r"--entities NAME.*a\.weight.*b"):
        imported(*typed)
    with pytest.raises(SystemExit, match="expected one tensor c"):
        imported(*typed, "--entities", "c")
    for options in (["--entities", "b"], ["--entities", "b", "--relations", "a.weight"]):
        bundle = imported(*typed, *options)
        assert bundle.entities.tobytes() == ENTITIES.tobytes()
        assert bundle.relations.tobytes() == (ENTITIES * 2).tobytes()
    torch.save({"b": STATE["entities"]}, folder / "t.pt")
    with pytest.raises(SystemExit, match="--relations NAME"):
        imported(*typed)


@pytest.mark.parametrize(
    "pair", [("epoch_9.pt", "epoch_10.pt"), ("best.pt", "last.pt"), ("m.pt", "m.safetensors")]
)
def test_a_table_in_two_files_is_refused_unless_one_is_chosen(pair: tuple[str, str]) -> None:
    folder = write_lists()
    for number, name in enumerate(pair, 1):
        state = {key: values * number for key, values in STATE.items()}
        save = save_tensors if name.endswith("safetensors") else torch.save
        save(state, folder / name)
    with pytest.raises(SystemExit) as error:
        imported(str(folder), "--model", "distmult")
    assert all(part in str(error.value) for part in (*pair, "--tensors FILE"))
    assert not Path("out").exists()
    bundle = imported(str(folder), "--model", "distmult", "--tensors", str(folder / pair[0]))
    assert bundle.entities.tobytes() == ENTITIES.tobytes()


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
def test_a_model_of_pykeen_scores_the_same_by_its_state_dict_and_by_its_pickle(
    saved: Callable[[str], tuple[Any, Path]], name: str
) -> None:
    model, folder = saved(name)
    by_pickle = imported(str(folder), "--trust-pickle")
    by_state = imported(str(folder), "--model", *MODELS[name])
    assert by_state.entities.tobytes() == by_pickle.entities.tobytes()
    np.testing.assert_allclose(by_state.relations, by_pickle.relations, rtol=1e-6)
    options = [dict(vars(loaded.model)) for loaded in (by_state, by_pickle)]
    margins = [each.pop("margin", 0.0) for each in options]
    assert margins[0] == pytest.approx(margins[1])
    assert options[0] == options[1]
    assert ("constraint" in by_pickle.manifest.model_options) == (
        "constraint=sphere" in MODELS[name]
    )
    assert by_state.entity_names[0] == "brazil"
    assert len(by_state.triples) == 1592
    margin = getattr(by_state.model, "margin", 0.0)
    for slot, theirs in ((TAIL, model.score_t), (HEAD, model.score_h)):
        given = torch.tensor([0, 3, 13])
        pairs = [given, torch.full_like(given, 7)]
        with torch.no_grad():
            expected = theirs(torch.stack(pairs if slot == TAIL else pairs[::-1], 1))
        torch.testing.assert_close(
            by_state.scores(given, 7, slot) - margin, expected, rtol=1e-4, atol=1e-4
        )


def test_inverse_triples_are_named_for_a_state_dict_as_for_a_pickle(tmp_path: Path) -> None:
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
    torch.save(model, tmp_path / "trained_model.pkl")
    for options in (["--model", "distmult"], ["--trust-pickle"]):
        with pytest.raises(SystemExit, match=r"inverse triples.*isi\.pykeen\.insert"):
            imported(str(tmp_path), *options)


def test_a_pickle_is_not_read_unless_it_is_trusted(
    saved: Callable[[str], tuple[Any, Path]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, folder = saved("DistMult")
    evil = tmp_path / "evil"
    evil.mkdir()
    (evil / "training_triples").symlink_to(folder / "training_triples")
    for name in ("trained_model.pkl", "state.pt"):
        torch.save(Bomb(), evil / name)
    for more in ([], ["--tensors", "evil/state.pt"], ["--tensors", "evil/trained_model.pkl"]):
        with pytest.raises(SystemExit):
            imported("evil", "--model", "distmult", *more)
    assert not Path("exploded").exists()
    with pytest.raises(
        SystemExit, match=r"evil/trained_model\.pkl: NoneType: expected a model with vectors"
    ):
        imported("evil", "--trust-pickle")
    assert Path("exploded").exists()  # the help warns of this
    main(["import", "--help"])
    assert "can have it run any program" in " ".join(capsys.readouterr().out.split())
