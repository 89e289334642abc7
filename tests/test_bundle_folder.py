"""The folder of a bundle is read as it was written, or refused in one line;
and the pipeline's final model.
"""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from isi.live.folder import Bundle, EntityRecord, read
from safetensors.numpy import load_file

from isi.errors import InputError
from isi.experiment.final_model import train_final, usual_epochs, whole_graph
from isi.models.stack import uniform
from isi.training.batches import training_data
from isi.training.trainer import run_epoch, start
from tests.small_bundle import NAMES, TRIPLES, files, small, written
from tests.small_graphs import random_graph
from tests.small_grid import LEARNING

CELLS = st.text(st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"]), max_size=20)
RECORD = EntityRecord(
    entity="lie on",
    insert_triples=[("bed", "hasAffordance", "lie on")],
    definition="to rest",
    requested_initializer=None,
    options={"k": 2},
    seed=3,
    initializer="rs",
    why="the best",
    fallback=None,
)


def same(one: Bundle, other: Bundle) -> bool:
    return all(
        np.array_equal(ours, theirs)
        and getattr(ours, "dtype", None) == getattr(theirs, "dtype", None)
        for ours, theirs in (
            (getattr(one, field.name), getattr(other, field.name)) for field in fields(Bundle)
        )
    )


@given(
    names=st.lists(CELLS.filter(str.strip), min_size=len(NAMES), max_size=len(NAMES), unique=True),
    cells=st.lists(CELLS, min_size=2 * len(NAMES), max_size=2 * len(NAMES)),
    dtype=st.sampled_from([np.float32, np.float64]),
    words=st.booleans(),
)
def test_what_is_written_is_read_again(
    tmp_path_factory: pytest.TempPathFactory,
    names: list[str],
    cells: list[str],
    dtype: type,
    words: bool,
) -> None:
    kinds, phrases = cells[: len(NAMES)], cells[len(NAMES) :]
    bundle = small(
        entity_names=names, kinds=kinds, phrases=phrases, **({} if words else {"words": None})
    )
    bundle = replace(bundle, entities=bundle.entities.astype(dtype))
    assert same(read(written(tmp_path_factory.mktemp("kept") / "one", bundle)), bundle)


def test_other_tools_read_the_files_and_the_manifest_is_read_again(tmp_path: Path) -> None:
    manifest = small().manifest.model_copy(
        update={"inserted": [RECORD], "made": {"by": {"whom": ["", None, 1.5]}}}
    )
    bundle = small(manifest=manifest)
    path = written(tmp_path / "one", bundle)
    assert read(path).manifest == manifest
    assert sorted(files(path)) == [
        "embedding.json",
        "entities.tsv",
        "relations.tsv",
        "triples.tsv",
        "vectors.safetensors",
    ]
    assert pd.read_csv(path / "entities.tsv", sep="\t")["entity"].tolist() == bundle.entity_names
    assert pd.read_csv(path / "triples.tsv", sep="\t").to_numpy().tolist()[0] == [
        "kettle",
        "atLocation",
        "kitchen",
    ]
    assert (
        load_file(path / "vectors.safetensors")["relations"].tolist() == bundle.relations.tolist()
    )
    assert json.loads((path / "embedding.json").read_text(encoding="utf-8"))["triples"] == len(
        TRIPLES
    )


def test_equal_embeddings_are_equal_bytes_and_take_the_place_of_others(tmp_path: Path) -> None:
    first, second = (
        written(tmp_path / "one"),
        written(tmp_path / "two", small(kinds=[""] * len(NAMES))),
    )
    assert files(first) != files(second)
    assert files(first) == files(written(second))
    assert {path.name for path in tmp_path.iterdir()} == {"one", "two"}


@pytest.mark.parametrize(
    "name", ["a\tb", "a\nb", "a\rb", "\x1b[2J", "a\x85b", "a\u2028b", "a\x00", " ", ""]
)
@pytest.mark.parametrize("column", ["entity_names", "relation_names"])
def test_names_that_break_a_table_are_refused_before_anything_is_written(
    tmp_path: Path, column: str, name: str
) -> None:
    with pytest.raises(InputError, match=r"\.tsv: line 2\b"):
        written(tmp_path / "one", small(**{column: [name, *getattr(small(), column)[1:]]}))
    assert not list(tmp_path.iterdir())


def test_a_write_that_fails_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "one")
    before, write_bytes = files(path), Path.write_bytes

    def fails(file: Path, content: bytes) -> int:
        if file.name == "triples.tsv":
            raise OSError(28, "No space left on device")
        return write_bytes(file, content)

    monkeypatch.setattr(Path, "write_bytes", fails)
    with pytest.raises(
        InputError, match=r"one: cannot be written \(No space left on device; .* free there\)$"
    ):
        written(path, small(kinds=[""] * len(NAMES)))
    assert files(path) == before
    assert [file.name for file in tmp_path.iterdir()] == ["one"]


def test_what_a_killed_write_left_goes_and_nobody_elses(tmp_path: Path) -> None:
    left, others = (
        [".o[n]e.7.tmp", ".o[n]e.7.old.tmp"],
        [".o[n]e.two.7.tmp", ".o[n]e.mine.tmp", ".one.7.tmp"],
    )
    for name in left + others:
        (tmp_path / name).mkdir()
    written(tmp_path / "o[n]e")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["o[n]e", *others])


# The final model of the pipeline


def test_the_usual_epochs_are_the_lower_median_of_the_last_that_were_kept() -> None:
    rows = [
        (0, 5, True),
        (0, 10, True),
        (0, 15, False),
        (1, 5, True),
        (2, 20, True),
        (2, 25, False),
        (3, 15, True),
    ]
    log = pd.DataFrame(rows, columns=["seed", "epoch", "kept"])
    assert usual_epochs(log) == 10  # of 5, 10, 15, 20
    with pytest.raises(
        InputError, match="column 'kept': expected true in at least one row, a best epoch"
    ):
        usual_epochs(log.assign(kept=False))


def test_all_triples_are_learned_in_as_many_epochs() -> None:
    graph, config = random_graph(12, 2, 40), LEARNING
    points = whole_graph("home", graph)
    learned, again = (train_final(points, config, 3) for _ in range(2))
    assert torch.equal(learned.entity, again.entity)
    session, keys = points.last_session, torch.tensor([[0, 0]])
    assert (session.splits == 0).all()
    state = start(
        uniform(
            session.entities,
            2,
            config.model,
            config.dimension,
            config.init_range,
            config.root,
            keys,
        )
    )
    data = training_data(session, "training", keys, config.negatives.head_pool)
    assert data.counts.sum() == graph.counts.sum()
    for epoch in (1, 2, 3):
        run_epoch(state, data, config.negatives, config.training, config.root, epoch)
    assert torch.equal(learned.entity, state.embedding.entity)
    assert torch.equal(learned.relation, state.embedding.relation)
