"""``isi import`` of PyKEEN's directories: models score the same here, and no pickle is read that is not trusted."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from isi.__main__ import main
from isi.bundle.query import OpenBundle, open_bundle
from isi.graph.graph import HEAD, TAIL


def opened(*arguments: str) -> OpenBundle:
    """What is imported, ready to be asked."""
    main(["import", *arguments, "--out", "out"])
    return open_bundle(Path("out"))


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Any, Path]]:
    """A model of PyKEEN's after one epoch, and the folder that PyKEEN's pipeline saved it in."""
    pytest.importorskip("pykeen", reason="the extra `pykeen` is not installed")
    from pykeen.pipeline import pipeline

    done: dict[str, tuple[Any, Path]] = {}
    kinds = {"TransE squared": ("TransE", {"scoring_fct_norm": 2, "power_norm": True}),
             "TransE L1": ("TransE", {"scoring_fct_norm": 1})}  # fmt: skip

    def train(name: str) -> tuple[Any, Path]:
        if name not in done:
            model, options = kinds.get(name, (name, {}))
            result = pipeline(
                dataset="nations", model=model, model_kwargs={"embedding_dim": 6, **options}, random_seed=0,
                training_kwargs={"num_epochs": 1, "use_tqdm": False}, evaluation_kwargs={"use_tqdm": False},
                device="cpu",
            )  # fmt: skip
            folder = tmp_path_factory.mktemp("pykeen")
            result.save_to_directory(folder)
            torch.save(result.model.state_dict(), folder / "state.pt")
            done[name] = (result.model, folder)
        return done[name]

    return train


MODELS = {
    "DistMult": ["distmult"], "ComplEx": ["complex"], "RotatE": ["rotate"], "TransE L1": ["transe_l1"],
    "TransE squared": ["transe", "--set", "squared=true"],
}  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
def test_a_model_of_pykeen_scores_the_same_by_its_state_dict_and_by_its_pickle(
    saved: Callable[[str], tuple[Any, Path]], name: str
) -> None:
    model, folder = saved(name)
    by_pickle = opened(str(folder), "--trust-pickle")
    by_state = opened(str(folder), "--family", *MODELS[name])
    assert by_state.entities.tobytes() == by_pickle.entities.tobytes()
    np.testing.assert_allclose(by_state.relations, by_pickle.relations, rtol=1e-6)
    assert vars(by_state.model) == pytest.approx(vars(by_pickle.model))
    assert by_state.entity_names[0] == "brazil"
    assert len(by_state.triples) == 1592
    margin = getattr(by_state.model, "margin", 0.0)
    for slot, theirs in ((TAIL, model.score_t), (HEAD, model.score_h)):
        given = torch.tensor([0, 3, 13])
        pairs = [given, torch.full_like(given, 7)]
        with torch.no_grad():
            expected = theirs(torch.stack(pairs if slot == TAIL else pairs[::-1], 1))
        torch.testing.assert_close(by_state.scores(given, 7, slot) - margin, expected, rtol=1e-4, atol=1e-4)


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
            opened("evil", "--family", "distmult", *more)
    assert not Path("exploded").exists()
    with pytest.raises(SystemExit, match=r"evil/trained_model\.pkl: NoneType: expected a model with one"):
        opened("evil", "--trust-pickle")
    assert Path("exploded").exists()  # which is what the help warns of
    main(["import", "--help"])
    assert "can have it run any program" in " ".join(capsys.readouterr().out.split())


class Bomb:
    """Makes a folder when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("exploded",)
