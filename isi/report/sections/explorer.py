"""Single insertions to look through: indicators, a map, and ranked answers, entity by entity."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from isi.analyses.single_insertions import HIDDEN, SHOWN, SINGLE_ANSWERS, THETA0, TRUE, ExplorerParams
from isi.errors import InputError
from isi.report.models import JOINT, colour, label
from isi.report.prose import joined
from isi.report.results import Experiment, Results
from isi.report.section import Content, Explorer, Section

#: The tables of ``singles.TABLES``, by name.
Shown = Mapping[str, pd.DataFrame]
#: A model, and the epoch after which it is shown.
Step = tuple[str, int]
#: Indicators whose share of a centre is below this are left out.
LEAST = 0.005
#: Entities in no set that are named, at most.
FEW = 12


def contents(results: Results) -> Iterator[Content]:
    """What to look for, and the explorer."""
    if results.explorer is None or results.explorer.found["entities"].empty:
        return
    experiment, found = results.explorer.experiment, results.explorer.found
    how, rows = results.params.explorer, found["entities"]
    absent = experiment.entities["entity"].drop(rows["entity"])
    yield (
        "What one entity becomes: choose it, or type a few letters. "
        f"{len(rows)} of the {len(experiment.entities)} entities of {experiment.title} are in one of the sets of "
        f"{how.size} that seeds insert together; each is shown as in the first seed that has it"
        + (f" (in none: {joined(absent)})." if 0 < len(absent) <= FEW else ".")
    )
    yield (
        "The rank of an answer is its place among all entities of the session, none left out; ranks of tables leave "
        "out what was learned."
    )
    try:
        yield Explorer(data_of(experiment, found, how))
    except KeyError as error:
        expected = f"expected places and answers of each entity after each step, but {error} lacks"
        raise InputError(SINGLE_ANSWERS.path(experiment=experiment.name), "", expected) from error


def data_of(experiment: Experiment, found: Shown, how: ExplorerParams) -> dict[str, Any]:
    """All that the explorer shows, in as few numbers as say it: entities by id, ranks and rounded places as integers.

    Coordinates, similarities and weights are in hundredths; who has none has null.
    """
    models, relations = [*SHOWN, how.best], sorted(set(found["answers"]["relation"]))
    steps = [(JOINT, 0), *((model, epoch) for model in models for epoch in (0, how.epochs))]
    rows, places = found["entities"], found["places"]
    indicators = indicators_of(found["indicators"])
    queries = queries_of(found["answers"], how.answers, steps, relations)
    novel = places[places["model"] != THETA0]
    at = {tuple(key): place for *key, place in zip(*(novel[name] for name in ("entity", "model", "epoch")),
                                                    _hundredths_of(novel), strict=True)}  # fmt: skip
    return {
        "names": experiment.entities["entity"].tolist(),
        "kinds": experiment.entities["kind"].tolist(),
        "relations": relations,
        "models": [{"name": name, "label": label(name), "colour": colour(name, models)} for name in models],
        "joint": label(JOINT),
        "epochs": how.epochs,
        "start": start(experiment, rows.set_index("entity")["told"]),
        "maps": maps_of(places[places["model"] == THETA0], rows),
        "entities": {
            str(entity): {
                "seed": seed,
                "places": [at[entity, *step] for step in steps],
                "indicators": [indicators.get((entity, model)) for model in models],
                "queries": queries[entity],
            }
            for entity, seed in zip(rows["entity"].tolist(), rows["seed"].tolist(), strict=True)
        },
    }


def start(experiment: Experiment, told: pd.Series) -> int:
    """The entity that is shown at first: of the most common kind, the one that most was told of."""
    kinds = experiment.entities["kind"]
    return int(told[(kinds[told.index] == kinds.mode()[0]).to_numpy()].idxmax())


def maps_of(known: pd.DataFrame, rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Of each seed: the known entities, where they lie, and what the map holds and fits, in per cent."""
    shares = rows.drop_duplicates("seed").set_index("seed")
    return {
        str(seed): {
            "known": own["entity"].tolist(), "at": _hundredths_of(own),
            "shown": round(100 * shares["shown"][seed]), "fitted": round(100 * shares["fitted"][seed]),
        }
        for seed, own in known.groupby("seed")
    }  # fmt: skip


def indicators_of(rows: pd.DataFrame) -> dict[tuple[int, str], dict[str, Any]]:
    """Of each entity and model: whose indicators they are where not the model's own, and their ids and numbers.

    Weights are null where they are all the same.
    """
    found: dict[tuple[int, str], dict[str, Any]] = {}
    columns = ["entity", "model", "fallback", "indicator", "weight", "by_words", "by_relations"]
    large = rows.loc[rows["weight"] >= LEAST, columns]
    weighed = large.groupby(["entity", "model"])["weight"].transform("nunique") > 1
    for uneven, row in zip(weighed, large.itertuples(index=False, name=None), strict=True):
        entity, model, fallback, indicator, weight, words, relations = row
        whose = fallback if isinstance(fallback, str) else None
        weights: list[int | None] | None = [] if uneven else None
        empty: dict[str, Any] = {"fallback": whose, "ids": [], "weight": weights, "words": [], "relations": []}
        own = found.setdefault((entity, model), empty)
        own["ids"].append(indicator)
        if uneven:
            own["weight"].append(_hundredths(weight))
        own["words"].append(_hundredths(words))
        own["relations"].append(_hundredths(relations))
    return found


def queries_of(
    answers: pd.DataFrame, first: int, steps: Sequence[Step], relations: Sequence[str]
) -> dict[int, list[dict[str, Any]]]:
    """The queries about each entity, those with true answers first: the first answers, and ranks of the true ones."""
    ranked: dict[Any, dict[Step, list[tuple[int, int, Any]]]] = defaultdict(lambda: defaultdict(list))
    columns = ["entity", "relation", "hidden", "model", "epoch", "answer", "rank", "true"]
    for entity, relation, hidden, model, epoch, *answer in answers[columns].itertuples(index=False, name=None):
        ranked[entity, relation, hidden][model, epoch].append(tuple(answer))
    found = defaultdict(list)
    for (entity, relation, hidden), by_step in ranked.items():
        status = {answer: TRUE.index(true) for answer, _, true in sorted(by_step[JOINT, 0]) if isinstance(true, str)}
        ranks = [{answer: rank for answer, rank, _ in by_step[step]} for step in steps]
        found[entity].append({
            "relation": relations.index(relation), "hidden": list(HIDDEN).index(hidden),
            "true": list(status), "status": list(status.values()),
            "first": [[answer for answer, rank in own.items() if rank <= first] for own in ranks],
            "ranks": [[own[answer] for answer in status] for own in ranks],
        })  # fmt: skip
    return {entity: sorted(own, key=lambda query: not query["true"]) for entity, own in found.items()}


def _hundredths_of(places: pd.DataFrame) -> list[list[int]]:
    points: list[list[int]] = (100 * places[["x", "y"]]).round().astype(int).to_numpy().tolist()
    return points


def _hundredths(value: float) -> int | None:
    return None if pd.isna(value) else round(100 * value)


SECTION = Section("explorer", "An explorer of insertions", contents)
