"""Files of the steps of chains, so that a run that was killed goes on where it ended."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from isi.continual.along import Step
from isi.continual.experiment import COSTS, MATRIX, Chain, ContinualExperiment
from isi.continual.timeline import SPLITS, Timeline
from isi.insertion.inverses import InverseRelations
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.tables import io

if TYPE_CHECKING:
    import pandas as pd

STAGE = "grow"  #: In the metadata of the files.


@dataclass(frozen=True, eq=False)
class Parts:
    """The steps of an experiment in a folder.

    The names of a step's files are a digest of all that it depends on: code, settings, triples and
    the step before it. So a file of other settings is never read. The embedding of a step is
    removed when the next one has its files, and after the last snapshot.
    """

    folder: Path
    settings: ContinualExperiment
    timeline: Timeline
    words: np.ndarray | None  #: of all entities, (E, v)
    code: str  #: digest of what else decides the numbers
    _keys: dict[tuple[Chain, int], str] = field(default_factory=dict)

    @property
    def last(self) -> int:
        """The last snapshot."""
        return len(self.timeline.snapshots) - 1

    def begun(self, chain: Chain) -> int:
        """The first snapshot whose step must be computed; one after the last if none must."""
        if chain.initializer is None:
            return int(all(path.exists() for path in self._files(chain, 0)))
        snapshot = 1
        while snapshot <= self.last and self._rows(chain, snapshot).exists():
            snapshot += 1
        if snapshot > self.last:
            return snapshot
        while snapshot > 1 and not self._embedding(chain, snapshot - 1).exists():
            snapshot -= 1
        return snapshot

    def before(self, chain: Chain, snapshot: int, model: Model) -> Embedding | None:
        """The embedding of a chain before a snapshot; None before the first."""
        if snapshot == 0:
            return None
        path = self._embedding(chain if snapshot > 1 else chain.first, snapshot - 1)
        tables = io.read_tensors(path, ["entity", "relation"])
        return Embedding(tables["entity"], tables["relation"], InverseRelations(model))

    def store(self, chains: Sequence[Chain], snapshot: int, place: int, step: Step) -> None:
        """Write the files of a step of the chain at a place; that of ``matrix``, which says that
        the step is done, last.
        """
        chain = chains[place]
        is_first = chain.initializer is None
        if is_first or snapshot < self.last:
            tables = {"entity": step.theta.entity, "relation": step.theta.relation}
            io.write_tensors(self._embedding(chain, snapshot), tables, STAGE)
        for table, path, frame in (
            (COSTS, self._costs(chain, snapshot), step.costs),
            (MATRIX, self._rows(chain, snapshot), step.matrix),
        ):
            table.write_file(path, frame.assign(**chain.columns), STAGE)
        if snapshot > 1:
            self._embedding(chain, snapshot - 1).unlink(missing_ok=True)

    def tables(self, experiment: str) -> tuple[pd.DataFrame, pd.DataFrame]:
        """The rows of ``MATRIX`` and of ``COSTS`` of all chains; all other files are removed."""
        import pandas as pd

        first, chains = self.settings.first(experiment), self.settings.chains(experiment)
        steps = [(chain, 0) for chain in first]
        steps += [(chain, snapshot) for chain in chains for snapshot in range(1, self.last + 1)]
        kept = [self._embedding(chain, 0) for chain in first]
        rows, costs = list[pd.DataFrame](), list[pd.DataFrame]()
        for chain, snapshot in steps:
            rows.append(MATRIX.read_file(self._rows(chain, snapshot)).astype(TEXTS))
            costs.append(COSTS.read_file(self._costs(chain, snapshot)).astype(TEXTS))
            kept += [self._rows(chain, snapshot), self._costs(chain, snapshot)]
        io.keep_only(self.folder, kept)
        return pd.concat(rows, ignore_index=True), pd.concat(costs, ignore_index=True)

    def first(self, experiment: str) -> dict[str, Tensor]:
        """The tensors of ``FIRST``."""
        paths = [self._embedding(chain, 0) for chain in self.settings.first(experiment)]
        embeddings = [io.read_tensors(path, ["entity", "relation"]) for path in paths]
        return {
            name: torch.cat([tensors[name] for tensors in embeddings])
            for name in ("entity", "relation")
        }

    def _files(self, chain: Chain, snapshot: int) -> list[Path]:
        return [kind(chain, snapshot) for kind in (self._embedding, self._costs, self._rows)]

    def _embedding(self, chain: Chain, snapshot: int) -> Path:
        return self.folder / f"{self._key(chain, snapshot)}.safetensors"

    def _costs(self, chain: Chain, snapshot: int) -> Path:
        return self.folder / f"{self._key(chain, snapshot)}.costs.parquet"

    def _rows(self, chain: Chain, snapshot: int) -> Path:
        return self.folder / f"{self._key(chain, snapshot)}.parquet"

    def _key(self, chain: Chain, snapshot: int) -> str:
        """The digest of a step."""
        place = chain, snapshot
        if place not in self._keys:
            self._keys[place] = digest(*self._depends_on(chain, snapshot))
        return self._keys[place]

    def _depends_on(self, chain: Chain, snapshot: int) -> list[Any]:
        settings, training = self.settings, self.settings.training
        data = self._digest_of_data(snapshot)
        if chain.initializer is None:
            shared = settings.model_dump(
                include={"model", "model_options", "dimension", "most_tests"}
            )
            return [self.code, data, chain.seed, shared, training.model_dump(exclude={"epochs"})]
        before = self._key(chain if snapshot > 1 else chain.first, snapshot - 1)
        growth = settings.growth(chain)
        names = chain.initializer, growth.initializer, chain.strategy, growth.strategy
        options = dict(growth.options), dict(growth.strategy_options)
        return [before, data, names, *options, training.epochs]

    def _digest_of_data(self, snapshot: int) -> str:
        arrays = [self.timeline.snapshots[snapshot].split(name) for name in SPLITS]
        if self.words is not None:
            arrays.append(self.words[: self.timeline.entities[snapshot]])
        if self.timeline.classes is not None:
            arrays.append(self.timeline.classes)
        return digest(*[[array.shape, digest_of(array.tobytes())] for array in arrays])


#: Texts as objects, so that frames of several files join.
TEXTS = {"initializer": object, "strategy": object, "phase": object}


def digest(*values: Any) -> str:
    """A digest of values of JSON."""
    return digest_of(json.dumps(values, sort_keys=True).encode())


def digest_of(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


def digest_of_code(places: Iterable[str], *values: Any) -> str:
    """A digest of the modules in files and folders, of the version of torch, and of values."""
    paths = [Path(place) for place in places]
    files = {file for path in paths for file in (path, *path.rglob("*.py")) if file.is_file()}
    code = [[file.as_posix(), digest_of(file.read_bytes())] for file in sorted(files)]
    return digest(code, torch.__version__, *values)
