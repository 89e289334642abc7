"""Single insertions to look through: indicators, a map, and ranked answers, entity by entity."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from isi.analyses.single_insertions import HIDDEN, SHOWN, SINGLE_ANSWERS, THETA0, TRUE, ExplorerParams
from isi.errors import InputError
from isi.report.data import Experiment, Results
from isi.report.section import Content
from isi.report.words import JOINT, colour, label

#: A model, and the epoch after which it is shown.
Step = tuple[str, int]
#: Indicators whose share of a centre is below this are left out.
LEAST = 0.005
#: Entities in no set that are named, at most.
FEW = 12


def explorer(results: Results) -> Iterator[Content]:
    """How the entities were chosen, and the data of the explorer (``templates/explorer.js`` shows them)."""
    for experiment, tables in results.analysis("explorer"):
        absent = experiment.entities["entity"].drop(tables["entities"]["entity"]).tolist()
        if tables["entities"].empty:
            return
        try:
            data = _data(experiment, tables, results.params.explorer)
        except KeyError as error:
            expected = f"expected places and answers of each entity after each step, but {error} lacks"
            path = SINGLE_ANSWERS.path(experiment=experiment.name).with_name(f"{experiment.name}.*.parquet")
            raise InputError(path, "", expected) from error
        yield Content({"experiment": experiment, "data": data, "absent": absent if len(absent) <= FEW else []})


def _data(experiment: Experiment, tables: Mapping[str, pd.DataFrame], settings: ExplorerParams) -> dict[str, Any]:
    """All that the explorer shows, in as few numbers as say it: entities by id, ranks and rounded places as integers.

    Coordinates, similarities and weights are in hundredths; null where there is none.
    """
    models, relations = [*SHOWN, settings.best], sorted(set(tables["answers"]["relation"]))
    steps = [(JOINT, 0), *((model, epoch) for model in models for epoch in (0, settings.epochs))]
    rows, places = tables["entities"], tables["places"]
    indicators = indicators_of(tables["indicators"])
    queries = queries_of(tables["answers"], settings.answers, steps, relations)
    novel = places[places["model"] != THETA0]
    keys = novel[["entity", "model", "epoch"]].itertuples(index=False, name=None)
    place_of = dict(zip(keys, _points(novel), strict=True))
    return {
        "names": experiment.entities["entity"].tolist(), "kinds": experiment.entities["kind"].tolist(),
        "relations": relations,
        "models": [{"name": name, "label": label(name), "colour": colour(name, models)} for name in models],
        "joint": label(JOINT), "epochs": settings.epochs,
        "start": start(experiment, rows.set_index("entity")["told"]),
        "maps": maps_of(places[places["model"] == THETA0], rows),
        "entities": {
            str(entity): {
                "seed": seed, "places": [place_of[entity, *step] for step in steps],
                "indicators": [indicators.get((entity, model)) for model in models], "queries": queries[entity],
            }
            for entity, seed in zip(rows["entity"].tolist(), rows["seed"].tolist(), strict=True)
        },
    }  # fmt: skip


def start(experiment: Experiment, insert_triples: pd.Series) -> int:
    """The entity that is shown at first: of the most common kind, the one with most insert triples."""
    kinds = experiment.entities["kind"]
    return int(insert_triples[(kinds[insert_triples.index] == kinds.mode()[0]).to_numpy()].idxmax())


def maps_of(known: pd.DataFrame, rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Of each seed: the known entities, where they lie, and what the map holds and fits, in per cent."""
    shares = rows.drop_duplicates("seed").set_index("seed")
    return {
        str(seed): {"known": places["entity"].tolist(), "at": _points(places)}
        | {share: round(100 * shares[share][seed]) for share in ("shown", "fitted")}
        for seed, places in known.groupby("seed")
    }


def indicators_of(rows: pd.DataFrame) -> dict[tuple[int, str], dict[str, Any]]:
    """Of each entity and model: its fallback where the indicators are those of one, and their ids and numbers.

    Weights are null where they are all the same.
    """
    groups: dict[Any, pd.DataFrame] = dict(list(rows[rows["weight"] >= LEAST].groupby(["entity", "model"], sort=False)))
    return {
        place: {
            "fallback": next(iter(group["fallback"].dropna()), None), "ids": group["indicator"].tolist(),
            "weight": _hundredths(group["weight"]) if len(set(group["weight"])) > 1 else None,
            "words": _hundredths(group["by_words"]), "relations": _hundredths(group["by_relations"]),
        }
        for place, group in groups.items()
    }  # fmt: skip


def queries_of(
    answers: pd.DataFrame, first: int, steps: Sequence[Step], relations: Sequence[str]
) -> dict[int, list[dict[str, Any]]]:
    """The queries about each entity, those with true answers first: the first answers, and ranks of the true ones."""
    ranked: dict[Any, dict[Step, list[tuple[int, int, Any]]]] = defaultdict(lambda: defaultdict(list))
    columns = ["entity", "relation", "hidden", "model", "epoch", "answer", "rank", "true"]
    for entity, relation, hidden, model, epoch, *answer in answers[columns].itertuples(index=False, name=None):
        ranked[entity, relation, hidden][model, epoch].append(tuple(answer))
    queries = defaultdict(list)
    for (entity, relation, hidden), by_step in ranked.items():
        status = {answer: TRUE.index(true) for answer, _, true in sorted(by_step[JOINT, 0]) if isinstance(true, str)}
        ranks = [{answer: rank for answer, rank, _ in by_step[step]} for step in steps]
        queries[entity].append({
            "relation": relations.index(relation), "hidden": list(HIDDEN).index(hidden),
            "true": list(status), "status": list(status.values()),
            "first": [[answer for answer, rank in of_step.items() if rank <= first] for of_step in ranks],
            "ranks": [[of_step[answer] for answer in status] for of_step in ranks],
        })  # fmt: skip
    return {entity: sorted(group, key=lambda query: not query["true"]) for entity, group in queries.items()}


def _points(places: pd.DataFrame) -> list[list[int]]:
    points: list[list[int]] = (100 * places[["x", "y"]]).round().astype(int).to_numpy().tolist()
    return points


def _hundredths(values: pd.Series) -> list[int | None]:
    return [None if pd.isna(value) else round(100 * value) for value in values]
