"""From simulation to the real: what became of Matterport3D's entities (section 6.3, Figure 4 and Table 3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from isi import candidates
from isi.report.figures import Figure, follow
from isi.report.results import JOINT, Results
from isi.report.tables import HALVES, Table, label
from isi.tables import AT_LOCATION

#: Answers to (entity, hasAffordance, ?) that are shown and counted.
TOP = 4
_SHOWN = ("es", "rs", "ers", "xavier")


def mined(results: Results) -> Table:
    """What Matterport3D adds to the graph."""
    transfer, minimum = results.transfer, results.params.mp3d.min_observations
    new = transfer.entities["source"] == "mp3d"
    unknown = candidates.unknown_objects(transfer.observations, transfer.entities[~new], "mp3d")
    lines = dict(results.mined) | {
        "of these, of objects that AI2-THOR has not": int(unknown.sum()),
        "kinds of such objects": len(unknown),
        f"of these, with at least {minimum} observations": int((unknown >= minimum).sum()),
        "drawn as candidates": int(new.sum()),
        "unique triples of the candidates": int((transfer.triples["source"] == "mp3d").sum()),
        "inserted in a repeat": results.params.transfer.size,
    }
    return Table(
        "transfer_mined",
        "From Matterport3D's tallies to novel entities",
        f"Counts left at each step. Matterport3D gives {AT_LOCATION} alone, (object, {AT_LOCATION}, room).",
        pd.DataFrame({"": list(lines), "count": list(lines.values())}),
    )


def immediate(results: Results) -> Table:
    """MRR* right after insertion, epochs to convergence, and the drop on earlier knowledge, beside the paper's."""
    transfer, paper = results.transfer, results.paper["transfer"]
    means = 100 * transfer.at_once.groupby(["model", "scope"])[list(HALVES)].mean()
    dropped = drop(results)
    epochs = transfer.convergence.groupby(["model", "scope"])["epochs"].mean()
    never = 1 - transfer.convergence.groupby(["model", "scope"])["converged"].mean()
    heldout = transfer.at_once[(transfer.at_once["scope"] == "novel_heldout") & (transfer.at_once["model"] == JOINT)]
    lines = []
    for model in transfer.models:
        line: dict[str, object] = {"model": label(model)}
        for scope, stated in (("all", "all_queries"), ("novel", "novel_queries")):
            for column, name in HALVES.items():
                line[f"{scope}: {name}"] = means[column].get((model, scope), np.nan)
            line[f"{scope}: paper"] = paper[stated].get(model, np.nan)
        line["drop %"], line["drop %: paper"] = dropped.get(model, np.nan), paper["drop"].get(model, np.nan)
        for scope in ("all", "novel_heldout"):
            line[f"epochs, {scope}"] = epochs.get((model, scope), np.nan)
            line[f"unconverged %, {scope}"] = 100 * never.get((model, scope), np.nan)
        line["epochs: paper"] = paper["epochs"].get(model, np.nan)
        lines.append(line)
    return Table(
        "transfer_immediate",
        "Matterport3D's entities inserted into AI2-THOR's embedding",
        "MRR* (points) right after insertion, with its entity and its relation half, over all queries and over those "
        "about the new entities; by how much MRR* over AI2-THOR's entities alone is lower with the new ones among the "
        "candidates than without (known against known_closed), in per cent; epochs to convergence, as in Table 2. In "
        f"scope novel_heldout there are {heldout['queries'].mean():.1f} triples a repeat to ask about, and none in "
        f"{int((heldout['queries'] == 0).sum())} of {len(heldout)} repeats.",
        pd.DataFrame(lines),
    )


def drop(results: Results) -> dict[str, float]:
    """By how much each model's MRR* in ``known`` is below that in ``known_closed`` at once, in per cent.

    Without the new entities among the candidates nothing has changed for earlier knowledge, so this is
    what inserting them costs.
    """
    means = results.transfer.at_once.groupby(["model", "scope"])["mrr_star"].mean().unstack("scope")
    lost = 100 * (1 - means["known"] / means["known_closed"])
    return {str(model): float(value) for model, value in lost.items() if model != JOINT}


def known_closed_at_the_end(results: Results) -> dict[str, float]:
    """MRR* (points) of AI2-THOR's entities among themselves after the last epoch."""
    runs = results.transfer.runs
    own = runs[(runs["scope"] == "known_closed") & (runs["epoch"] == results.params.finetuning.max_epochs)]
    return {str(model): float(value) for model, value in (100 * own.groupby("model")["mrr_star"].mean()).items()}


def figure4(results: Results) -> Figure:
    """Figure 4: MRR* over AI2-THOR's entities alone, by epoch of further training."""
    size = results.params.transfer.size
    canvas = follow(results.transfer, size, ("known", "known_closed"))
    return Figure(
        "figure4_transfer",
        "Figure 4. Earlier knowledge while Matterport3D's entities are learned",
        f"MRR* of queries about AI2-THOR's entities alone by epoch of further training on D¹, with {size} entities of "
        "Matterport3D inserted, mean and (but for controls) 95 % interval over repeats: the new entities "
        "among the candidates (left, the paper's figure) and not (right). What is lost on the left alone is "
        "crowding. Scales differ.",
        canvas,
    )


def affordances(results: Results) -> Table:
    """Table 3: what can be done with some of Matterport3D's entities, right after insertion."""
    return _ranked(
        results,
        _SHOWN,
        "table3_affordances",
        "Table 3. Affordances right after insertion",
        f"The {TOP} highest-ranked answers to (entity, hasAffordance, ?), each with its kind, by mean rank over the "
        "repeats that inserted the entity, of which it was told rooms alone. Answers are AI2-THOR's entities, which "
        "every repeat has. Those that are no affordance at all are marked ×.",
    )


def other_affordances(results: Results) -> Table:
    """The same with the other initializers."""
    others = tuple(name for name in results.initializers if name not in _SHOWN)
    title = "Table 3 with the other initializers"
    return _ranked(results, others, "table3_others", title, "As Table 3.")


def _ranked(results: Results, models: Sequence[str], name: str, title: str, caption: str) -> Table:
    lines = []
    for entity in results.params.affordances.entities:
        tops = {model: top_answers(results, model, entity) for model in models if model in results.initializers}
        for place in range(TOP):
            shown = {label(model): _marked(*answers[place]) if place < len(answers) else "–"
                     for model, answers in tops.items()}  # fmt: skip
            lines.append({"entity": entity, "": f"{place + 1}.", **shown})
    return Table(name, title, caption, pd.DataFrame(lines))


def _marked(answer: str, kind: str) -> str:
    return f"{'' if kind == 'affordance' else '× '}{answer} ({kind})"


def top_answers(results: Results, model: str, entity: str) -> list[tuple[str, str]]:
    """The answers of lowest mean rank over the repeats that inserted an entity, each with its kind."""
    entities = results.transfer.entities
    rows = results.affordances
    own = rows[(rows["model"] == model) & (rows["entity"] == entities.index[entities["entity"] == entity][0])]
    old = own[own["answer"].map(entities["source"]) == "ai2thor"]
    best = old.groupby("answer")["rank"].mean().sort_values(kind="stable").index[:TOP]
    return [(str(answer), str(kind)) for answer, kind in entities.loc[best, ["entity", "kind"]].to_numpy()]


def shares(results: Results) -> dict[str, float]:
    """Of the highest-ranked answers of all inserted entities, how many are affordances, in per cent."""
    hits = _hits(results)
    return {str(model): float(value) for model, value in (100 * hits.groupby("model")["hit"].mean()).items()}


def _hits(results: Results) -> pd.DataFrame:
    rows = results.affordances[results.affordances["rank"] <= TOP]
    return rows.assign(hit=rows["answer"].map(results.transfer.entities["kind"]) == "affordance")


def affordance_shares(results: Results) -> Table:
    """How often the highest-ranked answers are affordances at all, over everything that was inserted."""
    rows, names = _hits(results), results.initializers
    first = 100 * rows[rows["rank"] == 1].groupby("model")["hit"].mean()
    frame = pd.DataFrame({"initializer": [label(name) for name in names]})
    frame[f"top {TOP}: affordances %"] = pd.Series(shares(results)).reindex(names).to_numpy()
    frame["first: affordance %"] = first.reindex(names).to_numpy()
    inserted = len(results.transfer.novel)
    affordances = int((results.transfer.entities["kind"] == "affordance").sum())
    return Table(
        "affordance_shares",
        "How often the highest-ranked answers are affordances",
        f"Of the {TOP} highest-ranked answers to (entity, hasAffordance, ?) among all entities of D¹, in each repeat, "
        f"over all {inserted} inserted entities: how many are affordances, whichever they are, of which there are "
        f"{affordances}.",
        frame,
    )


TABLES = (mined, immediate, affordances, other_affordances, affordance_shares)
FIGURES = (figure4,)
