"""The graph of the main experiment, built as its stages build it,
and settings of all benchmarks.
"""

from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from isi.config import read
from isi.graph.graph import Graph, MinedSource, build_graph, build_tables
from isi.graph.sessions import Session, session_of, split
from isi.sources import Source
from isi.tables import paths
from stages.check_params import Params, load


def pytest_benchmark_update_machine_info(machine_info: dict[str, Any]) -> None:
    """Add the versions of packages to the description of the machine."""
    machine_info["versions"] = {
        name: version(name).partition("+")[0] for name in ("torch", "torchkge", "pykeen")
    }


@pytest.fixture(autouse=True, scope="session")
def _as_workers_do() -> None:
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)


@pytest.fixture(scope="session")
def params() -> Params:
    return load(paths.PARAMS)


@pytest.fixture(scope="session")
def home() -> Graph:
    """The graph of the experiment ``ai2thor``."""
    source = Source(read(paths.PARAMS)["sources"]["ai2thor"], "sources.ai2thor", 0)
    observations = pd.concat(source.frames())
    made = build_tables(MinedSource("ai2thor", observations, source.kinds))
    return build_graph(made.entities, made.triples)


def split_session(home: Graph, params: Params, models: int) -> Session:
    """A session of ``models`` models, each with the splits of its seed."""
    shares = params.sessions.valid, params.sessions.test
    return session_of(
        home,
        torch.from_numpy(np.stack([split(home, params.seed, s, *shares) for s in range(models)])),
    )
