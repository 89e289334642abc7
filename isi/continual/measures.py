"""The numbers that the field publishes about continual embeddings, from the frame of ``evaluate``.

R is the matrix R[i, j] of one measure (``score_matrix``), with i and j from 0 to T - 1, and NaN
where there is no value; its protocol is the caller's choice. Each formula names its source.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isi.continual.matrix import MEASURES, Phase, pooled

if TYPE_CHECKING:
    import pandas as pd

#: Protocols by which ``continual_measures`` computes what follows from R.
PUBLISHED = ("lkge", "incde", "revisiting", "current")


def score_matrix(
    frame: pd.DataFrame, protocol: str, measure: str = "mrr", phase: Phase = "trained"
) -> np.ndarray:
    """R[i, j] of a measure in the columns of ``evaluate``; shape (T, T), NaN where there is none.

    Example:
        >>> import pandas as pd
        >>> from isi.continual.measures import score_matrix
        >>> columns = {"phase": "trained", "protocol": "incde", "i": [0, 1, 1], "j": [0, 0, 1]}
        >>> values = dict.fromkeys(["mrr", "hits@1", "hits@3", "hits@10"], [0.5, 0.25, 1.0])
        >>> score_matrix(pd.DataFrame({**columns, "queries": 2, **values}), "incde")
        array([[0.5 ,  nan],
               [0.25, 1.  ]])
    """
    number = _snapshots(frame)
    chosen = frame[(frame["protocol"] == protocol) & (frame["phase"] == phase)]
    values = pooled(chosen)
    matrix = np.full((number, number), np.nan)
    matrix[values["i"], values["j"]] = values[measure]
    return matrix


def sizes_of_tests(frame: pd.DataFrame) -> np.ndarray:
    """Number of queries of each test set; shape (T,), 0 where the frame has none of it."""
    number = _snapshots(frame)
    by_test = pooled(frame).groupby("j")["queries"].max()
    sizes: np.ndarray = by_test.reindex(range(number), fill_value=0).to_numpy()
    return sizes


def _snapshots(frame: pd.DataFrame) -> int:
    """The number of snapshots of a frame, at least one: without queries, R is NaN."""
    return 1 + int(frame["i"].max()) if len(frame) else 1


def mean_after_last(r: np.ndarray, sizes: np.ndarray | None = None) -> float:
    """Mean over the test sets after the last snapshot: (1/T) Σ_j R[T-1, j], as IncDE states it
    (AAAI 2024); with ``sizes``, (T,), weighted by them, as LKGE's code does
    (``get_report_result``). The protocols are ``incde`` and ``lkge``.

    Example:
        >>> import numpy as np
        >>> from isi.continual.measures import mean_after_last
        >>> r = np.array([[0.5, np.nan], [0.25, 1.0]])
        >>> mean_after_last(r), mean_after_last(r, np.array([20, 10]))
        (0.625, 0.5)
    """
    weights = np.ones(len(r)) if sizes is None else sizes
    return float(weights @ r[-1] / weights.sum()) if weights.any() else np.nan


def forward_transfer(inserted: np.ndarray) -> float:
    """LKGE's FWT (AAAI 2023): 1/(T-1) Σ_{i≥1} R[i, i] before training on snapshot i. So R is of the
    phase ``inserted``; LKGE's protocol is ``lkge``.

    Example:
        >>> import numpy as np
        >>> from isi.continual.measures import forward_transfer
        >>> forward_transfer(np.array([[np.nan, np.nan], [0.25, 0.125]]))
        0.125
    """
    return _mean(np.diag(inserted)[1:])


def backward_transfer(r: np.ndarray) -> float:
    """LKGE's BWT (AAAI 2023): 1/(T-1) Σ_{j<T-1} (R[T-1, j] - R[j, j]); below 0: forgetting.
    LKGE's protocol is ``lkge``.

    Example:
        >>> import numpy as np
        >>> from isi.continual.measures import backward_transfer
        >>> backward_transfer(np.array([[0.5, np.nan], [0.25, 1.0]]))
        -0.25
    """
    return _mean((r[-1] - np.diag(r))[:-1])


def omega_new(hits: np.ndarray) -> float:
    """KGE-InfInit's Ω_new (arXiv 2511.11118, ``get_metrics.py``): 1/(T-1) Σ_{i≥1} R[i, i], with R
    of hits@3: what is learned of new snapshots. Its loader is that of LKGE's code:
    protocol ``lkge``.

    Example:
        >>> import numpy as np
        >>> from isi.continual.measures import omega_new
        >>> omega_new(np.array([[0.5, np.nan], [0.25, 0.75]]))
        0.75
    """
    return _mean(np.diag(hits)[1:])


def omega_base(hits: np.ndarray) -> float:
    """KGE-InfInit's Ω_base (arXiv 2511.11118, ``get_metrics.py``): 1/(T-1) Σ_{i≥1}
    min(1, R[i, 0] / R[0, 0]), with R of hits@3: what is still known of the first snapshot.
    Its loader is that of LKGE's code: protocol ``lkge``.

    Example:
        >>> import numpy as np
        >>> from isi.continual.measures import omega_base
        >>> omega_base(np.array([[0.5, np.nan], [0.25, 0.75]]))
        0.5
    """
    return _mean(np.minimum(1, _ratio(hits[1:, 0], hits[0, 0])))


def relative_forgetting(hits: np.ndarray, sizes: np.ndarray) -> float:
    """RevisitingCKGE's CF (arXiv 2604.19401, ``get_metrics.py``): Σ_{j<T-1} (R[T-1, j] - R[j, j]) /
    R[j, j] · s_j / (T-1-j), with R of hits@3 and s_j the share of test set j in the queries of all
    T test sets. Below 0: forgetting. Its protocol is ``revisiting``; its code divides by 4 - j for
    any T, which is the same for five snapshots.

    Example:
        >>> import numpy as np
        >>> from isi.continual.measures import relative_forgetting
        >>> relative_forgetting(np.array([[0.5, np.nan], [0.25, 0.75]]), np.array([10, 30]))
        -0.125
    """
    learned = np.diag(hits)
    change = _ratio(hits[-1] - learned, learned)[:-1]
    ages = np.arange(len(hits) - 1, 0, -1)
    if not sizes[:-1].any():
        return np.nan
    shares = sizes / sizes.sum()
    return float((change * shares[:-1] / ages).sum())


def historical(frame: pd.DataFrame, protocol: str, phase: Phase = "trained") -> float:
    """MEOR's H_old (protocol ``old``: among the entities before an update) and H_cur (protocol
    ``current``): the MRR of the queries of all earlier test sets, j < i, and the mean of it over
    updates i ≥ 1 and both slots, with equal weights.

    Ren, Gao and Jiang, 2026. D = H_old - H_cur is what new entities cost by interference. Their
    ties fall by id; here a tie counts ½.

    Example:
        >>> import pandas as pd
        >>> from isi.continual.measures import historical
        >>> rows = {"phase": "trained", "protocol": "current", "i": 1, "j": 0, "answer": "old"}
        >>> values = dict.fromkeys(["mrr", "hits@1", "hits@3", "hits@10"], [0.5, 0.25])
        >>> frame = pd.DataFrame({**rows, "slot": ["head", "tail"], "queries": [3, 1], **values})
        >>> historical(frame, "current")
        0.375
    """
    earlier = frame["j"] < frame["i"]
    return _mean_over_updates(frame[earlier & _is_of(frame, protocol, phase)])


def new_answers(frame: pd.DataFrame, phase: Phase = "trained") -> float:
    """MEOR's A_TN: the MRR of the queries of test set i whose answer arrived with snapshot i, under
    the protocol ``current``, and the mean of it over updates i ≥ 1 and both slots.

    Example:
        >>> import pandas as pd
        >>> from isi.continual.measures import new_answers
        >>> rows = {"phase": "trained", "protocol": "current", "i": 1, "j": 1, "answer": "new"}
        >>> values = dict.fromkeys(["mrr", "hits@1", "hits@3", "hits@10"], [0.5, 0.25])
        >>> frame = pd.DataFrame({**rows, "slot": ["head", "tail"], "queries": [3, 1], **values})
        >>> new_answers(frame)
        0.375
    """
    is_new = (frame["j"] == frame["i"]) & (frame["i"] > 0) & (frame["answer"] == "new")
    return _mean_over_updates(frame[is_new & _is_of(frame, "current", phase)])


def continual_measures(frame: pd.DataFrame) -> pd.DataFrame:
    """All measures of this module, from the joined frames of ``evaluate`` after snapshots 0 to
    T - 1, of the phase ``trained`` and, for ``forward_transfer``, ``inserted``.

    Returns:
        a row for each ``measure`` and ``protocol``: ``value``, NaN where the frame lacks a part.
        MEOR's H_cur, H_old, D and A_TN are once for each phase: ``H_cur inserted`` is right after
        insertion.

    Example:
        >>> import pandas as pd
        >>> from isi.continual import continual_measures
        >>> rows = {"phase": "trained", "protocol": "incde", "i": [0, 1, 1], "j": [0, 0, 1]}
        >>> values = dict.fromkeys(["mrr", "hits@1", "hits@3", "hits@10"], [0.5, 0.25, 1.0])
        >>> frame = pd.DataFrame({**rows, "slot": "tail", "answer": "old", "queries": 2, **values})
        >>> table = continual_measures(frame).dropna()
        >>> table[table["measure"].isin(["mean mrr", "backward transfer", "omega_base"])]
                      measure protocol  value
        13           mean mrr    incde  0.625
        22  backward transfer    incde -0.250
        24         omega_base    incde  0.500
    """
    import pandas as pd

    rows = [
        (name, protocol, value)
        for protocol in PUBLISHED
        for name, value in _of_matrix(frame, protocol).items()
    ]
    for phase in ("trained", "inserted"):
        h_old, h_cur = (historical(frame, name, phase) for name in ("old", "current"))
        rows += [
            (f"H_old {phase}", "old", h_old),
            (f"H_cur {phase}", "current", h_cur),
            (f"D {phase}", "old, current", h_old - h_cur),
            (f"A_TN {phase}", "current", new_answers(frame, phase)),
        ]
    return pd.DataFrame(rows, columns=["measure", "protocol", "value"])


def _of_matrix(frame: pd.DataFrame, protocol: str) -> dict[str, float]:
    """The measures that follow from R, by name."""
    by_measure = {name: score_matrix(frame, protocol, name) for name in MEASURES}
    r, hits, sizes = by_measure["mrr"], by_measure["hits@3"], sizes_of_tests(frame)
    means = {f"mean {name}": mean_after_last(values) for name, values in by_measure.items()}
    weighted = {
        f"weighted mean {name}": mean_after_last(values, sizes)
        for name, values in by_measure.items()
    }
    return {
        **means,
        **weighted,
        "forward transfer": forward_transfer(score_matrix(frame, protocol, phase="inserted")),
        "backward transfer": backward_transfer(r),
        "omega_new": omega_new(hits),
        "omega_base": omega_base(hits),
        "relative forgetting": relative_forgetting(hits, sizes),
    }


def _is_of(frame: pd.DataFrame, protocol: str, phase: str) -> pd.Series:
    return (frame["protocol"] == protocol) & (frame["phase"] == phase)


def _mean_over_updates(frame: pd.DataFrame) -> float:
    """Mean over pairs of an update and a slot of the MRR of all their queries."""
    return _mean(pooled(frame, ["i", "slot"])["mrr"].to_numpy())


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else np.nan


def _ratio(values: np.ndarray, base: np.ndarray | float) -> np.ndarray:
    """``values`` / ``base``, NaN where ``base`` is 0."""
    return values / np.where(np.equal(base, 0), np.nan, base)
