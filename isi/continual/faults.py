"""How many queries the faults of the published protocols touch, in any timeline."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isi.continual.answers import ENDS, query_of, true_answers
from isi.continual.timeline import Timeline
from isi.graph.graph import HEAD

if TYPE_CHECKING:
    import pandas as pd

FAULTS = ("validation facts unfiltered", "later entities", "later facts", "validated on test")


def fault_shares(timeline: Timeline) -> pd.DataFrame:
    """The share of the queries about the heads and tails of each test set that a fault touches.

    With the test set j, its entities E_j and its facts F_j (those known after snapshot j), and
    what is known after the last snapshot:

    ``validation facts unfiltered``: LKGE never reads valid.txt, so other right answers in it count
    as errors. IncDE, FastKGE and ETT-CKGE do read it.
    ``later entities``: RevisitingCKGE ranks among the entities of the model's snapshot, but filters
    by F_j. Right answers that arrived later, among entities outside E_j, count as errors.
    ``later facts``: among E_j, filtered by F_j, right answers that arrived later count as errors.
    ``validated on test``: LKGE stops and selects by the MRR of the test set. All its queries are
    touched, except those of triples that valid.txt has, too.

    Returns:
        a row for each fault and test set: ``fault``, ``test`` (j), ``queries``, ``share`` of them,
        and ``answers``, the mean number of such right answers over all queries (not a number for
        the last fault).

    Example:
        >>> from isi.continual import Timeline, fault_shares
        >>> first = [("cup", "in", "hall")], [("cup", "in", "den")], [("cup", "in", "bath")]
        >>> second = [("cup", "in", "attic")], [], []
        >>> fault_shares(Timeline.of([first, second])).query("test == 0")
                                 fault  test  queries  share  answers
        0  validation facts unfiltered     0        2    0.5      0.5
        1               later entities     0        2    0.5      0.5
        2                  later facts     0        2    0.0      0.0
        3            validated on test     0        2    1.0      NaN
    """
    import pandas as pd

    answers = [true_answers(timeline, slot) for slot in ENDS.values()]
    rows = []
    for j, snapshot in enumerate(timeline.snapshots):
        touched = dict[str, list[np.ndarray]]()
        for known in answers:
            is_known, is_old = known.arrival <= j, known.answer < timeline.entities[j]
            wrong = is_known & (known.arrival_in_lkge > j), ~is_known & ~is_old, ~is_known & is_old
            for fault, chosen in zip(FAULTS, wrong, strict=False):
                number = known.part(chosen).number(snapshot.test)
                touched.setdefault(fault, []).append(number)
        for fault, parts in touched.items():
            number = np.concatenate(parts)
            rows.append((fault, j, len(number), _mean(number > 0), _mean(number)))
        outside = ~_is_in(snapshot.test, snapshot.valid, timeline)
        rows.append((FAULTS[-1], j, 2 * len(outside), _mean(outside), np.nan))
    return pd.DataFrame(rows, columns=["fault", "test", "queries", "share", "answers"])


def _is_in(triples: np.ndarray, others: np.ndarray, timeline: Timeline) -> np.ndarray:
    """Whether each of ``triples``, (N, 3), is among ``others``; shape (N,), bool."""
    relations, entities = len(timeline.relation_names), len(timeline.entity_names)
    keys = [
        query_of(part, HEAD, relations) * entities + part[:, HEAD] for part in (triples, others)
    ]
    return np.isin(*keys)


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else np.nan
