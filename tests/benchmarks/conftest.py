"""The graph of the experiment, made as its stages make it, and settings that all benchmarks share."""

from __future__ import annotations

import os
from importlib.metadata import version
from typing import Any

import pyarrow as pa
import pytest
import torch

from isi import graph, paths
from isi.graph import Graph
from isi.params import Params, load
from isi.scenes import ai2thor, materials


def pytest_benchmark_update_machine_info(machine_info: dict[str, Any]) -> None:
    """Say what ran beside where it ran."""
    machine_info["cores"] = os.cpu_count()
    machine_info["versions"] = {name: version(name).partition("+")[0] for name in ("torch", "torchkge", "pykeen")}


@pytest.fixture(autouse=True, scope="session")
def _as_workers_do() -> None:
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)


@pytest.fixture(scope="session")
def params() -> Params:
    return load(paths.PARAMS)


@pytest.fixture(scope="session")
def home(params: Params) -> Graph:
    """The graph of AI2-THOR's scenes."""
    recording = ai2thor.locate(params.ai2thor.recording)
    shares = materials.read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES)
    scenes = ai2thor.read_recording(recording, params.ai2thor.sha256)
    mined = ai2thor.mine(scenes, materials.suncg(shares, params.seed), recording)
    observations = pa.concat_tables(mined).to_pandas()
    triples = graph.count_triples(observations, "ai2thor", params.graph.min_count)
    return graph.build(graph.name_entities(triples, set(observations["room"].astype(str)), "ai2thor"), triples)
