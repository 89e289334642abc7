"""Small timelines and embeddings of them, and ranks by plain loops over their definition."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from hypothesis import strategies as st

from isi.continual import Timeline
from isi.continual.timeline import SPLITS
from isi.models.model import make_model
from isi.models.stack import Embedding
from tests.plain_ranks import filtered_rank

Triple = tuple[str, str, str]
#: Of each protocol: the last snapshot of its candidates and of its filter, and the filter's splits.
DEFINITIONS = {
    "lkge": ("j", "j", ("train", "test")),
    "incde": ("j", "j", SPLITS),
    "revisiting": ("i", "j", SPLITS),
    "current": ("i", "i", SPLITS),
    "old": ("i - 1", "i", SPLITS),
}


@st.composite
def timelines(draw: st.DrawFn) -> Timeline:
    """Timelines whose triples may repeat, within a file and in later snapshots."""
    names = st.integers(0, 6).map("e{}".format)
    triples = st.tuples(names, st.sampled_from(["r", "s"]), names)
    files = st.lists(triples, max_size=5)
    snapshots = st.lists(st.tuples(files, files, files), min_size=1, max_size=3)
    return Timeline.of(draw(snapshots.filter(lambda parts: any(map(any, parts)))))


def whole_numbers(timeline: Timeline, i: int, seed: int = 0) -> Embedding:
    """A DistMult embedding of the entities of snapshot i with small whole numbers, so that scores
    are exact and many are equal.
    """
    rng = np.random.default_rng(seed)
    shapes = (1, int(timeline.entities[i]), 2), (1, int(timeline.relations[i]), 2)
    tables = (torch.from_numpy(rng.integers(-2, 3, shape)).float() for shape in shapes)
    return Embedding(*tables, make_model("distmult", {}, "model"))


def known_facts(timeline: Timeline, last: int, splits: Sequence[str]) -> set[tuple[int, ...]]:
    """All triples of splits of the snapshots up to ``last``."""
    return {
        tuple(triple)
        for snapshot in timeline.snapshots[: last + 1]
        for split in splits
        for triple in getattr(snapshot, split).tolist()
    }


def ranks_by_loops(
    theta: Embedding, timeline: Timeline, i: int, protocol: str
) -> Iterator[float | None]:
    """The rank of each query, tests 0 to i, heads before tails; None: not ranked."""
    entity, relation = theta.entity[0].numpy(), theta.relation[0].numpy()
    candidates, filtered, splits = DEFINITIONS[protocol]

    def score(head: int, name: int, tail: int) -> float:
        return float((entity[head] * relation[name] * entity[tail]).sum())

    for j in range(i + 1):
        snapshots = {"i": i, "j": j, "i - 1": i - 1}
        last, facts = snapshots[candidates], known_facts(timeline, snapshots[filtered], splits)
        for slot in (0, 2):
            for triple in timeline.snapshots[j].test.tolist():
                if last < j:
                    yield None
                    continue
                yield filtered_rank(score, triple, slot, range(int(timeline.entities[last])), facts)
