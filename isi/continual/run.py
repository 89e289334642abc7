"""The chains of an experiment, snapshot by snapshot, over the workers of a stage."""

from __future__ import annotations

from functools import partial
from importlib import import_module

from isi.continual.along import Along, Step
from isi.continual.experiment import Chain, ContinualExperiment
from isi.continual.parts import Parts
from isi.experiment.runner import Compute, run_each
from isi.models.stack import Embedding
from isi.random import seed_of


def run_chains(
    experiment: str,
    settings: ContinualExperiment,
    along: Along,
    parts: Parts,
    root: int,
    compute: Compute,
) -> None:
    """Compute the steps of all chains that ``parts`` lacks, one snapshot after the other.

    A step is stored as soon as it is done, so that what a killed run has finished is not computed
    again.
    """
    # an optimizer imports it, which would take seconds in each worker and count as training
    import_module("torch._dynamo")
    first, chains = settings.first(experiment), settings.chains(experiment)
    last = len(along.timeline.snapshots) - 1
    waves = [first, *[chains] * last]
    begun = {chain: parts.begun(chain) for chain in (*first, *chains)}
    missing = [
        [chain for chain in wave if begun[chain] <= snapshot] for snapshot, wave in enumerate(waves)
    ]
    total = sum(map(len, waves))
    left = sum(map(len, missing))
    model = settings.make_model(f"continual.{experiment}.model")
    for snapshot, wave in enumerate(missing):
        tasks = [
            (
                chain,
                along,
                parts.before(chain, 1, model) if snapshot else None,
                parts.before(chain, snapshot, model),
                settings,
                snapshot,
                root,
            )
            for chain in wave
        ]
        store = partial(parts.store, wave, snapshot)
        name = f"{experiment}, snapshot {snapshot} of {last}"
        if tasks:
            run_each(step_of, tasks, compute, name, store, (total - left, total))
        left -= len(wave)


def step_of(
    chain: Chain,
    along: Along,
    first: Embedding | None,
    before: Embedding | None,
    settings: ContinualExperiment,
    snapshot: int,
    root: int,
) -> Step:
    """The step of a chain after a snapshot, from its first embedding and that before the snapshot;
    None: the first is to be trained.
    """
    seed = seed_of(root, "a graph that grows", chain.seed)
    if first is None or before is None:
        model = settings.make_model(f"continual.{chain.experiment}.model")
        return along.first(model, settings.dimension, seed)
    growth, seconds = along.chosen(first, settings.growth(chain), seed)
    return along.next(before, growth, snapshot, seed, seconds if snapshot == 1 else 0.0)
