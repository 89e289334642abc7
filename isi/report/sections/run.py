"""The guide, the graphs and their training, leaks of word vectors,
and the params and counts of the run.
"""

import platform
import re
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd

from isi.params import Params
from isi.report import glossary
from isi.report.data import Experiment, Results
from isi.report.section import Content, Contents, Tables, of_each
from isi.report.sections.variants import relations_by_kind
from isi.report.stats import Values, where
from isi.report.tables import Column, Rows
from isi.report.words import HALVES, JOINT, SCOPES, in_order, label

_PACKAGES = (
    "dvc",
    "gensim",
    "matplotlib",
    "numpy",
    "pandas",
    "procthor",
    "pyarrow",
    "scipy",
    "torch",
)
#: Sections of params that the report's list of params omits.
UNUSED = ("compute", "recorder", "plots", "finetune_only", "final_model")
#: The page's words for fallbacks.
_FALLBACKS = {"centroid": "mean of all known vectors", "es": "ES", "rs": "RS"}
_TRIPLE = ["source", "head", "relation", "tail", "count"]


def guide(results: Results) -> Contents:
    """A drawing of the method, then the glossary."""
    yield Content({"words": glossary.of_the_page(), "initializers": glossary.of_models(results)})


def graph(results: Results) -> Contents:
    """Statistics of each standalone graph, then the training on all graphs."""
    yield from of_each(results.standalone, lambda experiment: _of_graph(results, experiment))
    yield Content({"of_all": True}, {"training": _training(results)})


def _of_graph(results: Results, experiment: Experiment) -> Content:
    paper, entities, triples = results.paper["graph"], experiment.entities, experiment.triples
    observations = results.observed[experiment.settings.graph.source].observations
    kinds = in_order(entities["kind"].unique(), results.vocabulary["kinds"])
    ours = {
        "observations": int(triples["count"].sum()),
        "unique_triples": len(triples),
        "entities": len(entities),
        **{f"{kind} entities": int((entities["kind"] == kind).sum()) for kind in kinds},
    }
    tables: Tables = {
        "graph_totals": [
            {"": name.replace("_", " "), "this run": number, "paper": paper.get(name)}
            for name, number in ours.items()
        ]
    }
    if observations["scene"].notna().any():
        words = results.vocabulary["relations"]
        tables["table1_graph_statistics"] = table1(
            observations, paper["median_per_environment"], words
        )
    by_kind = relations_by_kind(entities, triples)
    numbers = {
        "of_all": False,
        "ours": ours,
        "predicted": int(by_kind.max(axis=1).sum()),
        "leads": [f"{kind} to {relation}" for kind, relation in by_kind.idxmax(axis=1).items()],
    }
    return Content(numbers, tables)


def table1(
    observations: pd.DataFrame, paper: Mapping[str, Any], words: Mapping[str, str]
) -> pd.DataFrame:
    """Table 1: median counts per environment by room type, beside the paper's;
    ``words``: titles of relations.
    """
    rows = observations[observations["scene"].notna()]
    counts = rows.groupby(["scene", "relation"]).size().unstack(fill_value=0)
    counts = counts[in_order(counts.columns, list(words))].rename(columns=words)
    counts["object types"] = rows.groupby("scene")["head"].nunique()
    rooms = rows.groupby("scene")["room"].first()
    lines = list[dict[Column, Any]]()
    for room in [*in_order(sorted(rooms.dropna().unique()), list(paper)), "all"]:
        of_room = counts if room == "all" else counts[rooms == room]
        lines.append({Column("room"): room})
        for name, value in (of_room.median().to_dict() | {"rooms": len(of_room)}).items():
            theirs = "entities" if name == "object types" else str(name)
            number = paper.get(room, {}).get(theirs, np.nan)
            lines[-1] |= {
                Column(str(name)): float(value),
                Column(f"{theirs} (paper)", below=True): number,
            }
    return pd.DataFrame(lines).dropna(axis=1, how="all")


def _training(results: Results) -> Rows:
    """Rows for Θ⁰ and the joint model: epochs, validation MRR* (points),
    and coordinates in use (per cent).
    """
    rows = Rows()
    for experiment in results.experiments.values():
        for name, log in (("theta0", experiment.theta0_log), (JOINT, experiment.joint_log)):
            epochs = log.groupby(["size", "seed"])["epoch"].max()
            best = log[log["kept"]].groupby(["size", "seed"]).last()
            used = experiment.analyses.get("query_breakdown") if name == JOINT else None
            rows.append(
                {
                    _experiment(results.experiments): experiment.name,
                    Column("model", words={"theta0": "Θ⁰", JOINT: "joint model"}): name,
                    "trained": len(epochs),
                    "epochs": epochs.mean(),
                    "best epoch": best["epoch"].mean(),
                    **{
                        f"validation {shown}": 100 * best[column].mean()
                        for column, shown in HALVES.items()
                    },
                    "std": 100 * best["mrr_star"].std(ddof=1),
                    **({} if used is None else in_use(used)),
                }
            )
    return rows


def in_use(used: pd.DataFrame) -> Values:
    """Per cent of scalars and blocks that any relation uses;
    ``used``: rows of ``USED_COORDINATES``.
    """
    sums = used[used["relation"].isna()].groupby("part")[["used", "of"]].sum()
    return {
        f"{part} in use %": 100 * float(row["used"] / row["of"]) for part, row in sums.iterrows()
    }


def definitions(results: Results) -> Contents:
    """Triples that word vectors could leak: the definition of one end names the other end."""
    meaning = dict(
        zip(results.definitions["phrase"], results.definitions["definition"], strict=True)
    )
    graphs = [
        (experiment.entities, experiment.triples) for experiment in results.experiments.values()
    ]
    frame, number = leaks(graphs, meaning)
    counts, words = frame["defined"].value_counts(), results.params.words
    frame = frame.rename(columns={"defined": "defined end", "definition": "its definition"})
    used = words.source == "shipped" and words.text == "definition"
    yield Content({"used": used, "number": number, "counts": counts}, {"definition_leaks": frame})


def leaks(
    graphs: Iterable[tuple[pd.DataFrame, pd.DataFrame]], definitions: Mapping[str, str]
) -> tuple[pd.DataFrame, int]:
    """Triples in which the definition of one end names the other end,
    and the number of all distinct triples.
    """
    parts = []
    for entities, triples in graphs:
        phrase = dict(zip(entities["entity"], entities["phrase"], strict=True))
        for end, other in (("head", "tail"), ("tail", "head")):
            definition = triples[end].map(phrase).map(definitions)
            named = triples[other].map(phrase)
            parts.append(triples[_TRIPLE].assign(defined=end, definition=definition, named=named))
    every = pd.concat(parts).drop_duplicates([*_TRIPLE[:-1], "defined"])
    defined = every.dropna(subset=["definition"])
    given_away = [
        names(text, other)
        for text, other in zip(defined["definition"], defined["named"], strict=True)
    ]
    return defined.loc[given_away].drop(columns="named").reset_index(drop=True), len(every) // 2


def names(text: str, phrase: str) -> bool:
    """Whether a text contains a phrase, or the phrase with its first word regularly inflected."""
    first, *rest = phrase.split()
    stem, double = re.escape(first.removesuffix("e")), re.escape(first[-1])
    inflected = rf"(?:{stem}(?:e|s|es|d|ed|en|n|ing|{double}(?:ed|ing))?|{re.escape(first)})"
    pattern = r"\s+".join([inflected, *map(re.escape, rest)])
    return re.search(rf"\b{pattern}\b", text) is not None


def run(results: Results) -> Contents:
    """Counts by experiment, then params and versions of the run."""
    experiments = results.experiments
    coverage = pd.concat(experiment.coverage for experiment in experiments.values())
    sets = {
        each.title: len(each.novel[["size", "seed"]].drop_duplicates())
        for each in experiments.values()
    }
    inserted = {each.title: each.inserted for each in experiments.values()}
    numbers = {
        name: len(rows) // max(rows["model"].nunique(), 1) for name, rows in inserted.items()
    }
    uncovered = dict.fromkeys(coverage.loc[coverage["served_by"].isna(), "entity"], "")
    columns = {
        Column(name, title=experiment.title): _left_out(experiment)
        for name, experiment in experiments.items()
    }
    tables = {
        "left_out": pd.DataFrame(columns).rename_axis("").reset_index(),
        "ties": ties(experiments),
        "fallbacks": fallbacks(experiments),
    }
    yield Content(
        {"sets": sets, "inserted": numbers, **results.run, "uncovered": uncovered}, tables
    )


def what_was_run(params: Params) -> dict[str, dict[str, Any]]:
    """Params and versions; no time, place, machine or hash of the code,
    so that equal results have equal reports.
    """
    values = params.model_dump(exclude=set(UNUSED), exclude_unset=True)
    versions = {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES}
    return {"Params": dict(_flat(values)), "Versions": versions}


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        yield from (
            _flat(value, f"{prefix}{key}.")
            if isinstance(value, dict) and value
            else [(prefix + key, value)]
        )


def _left_out(experiment: Experiment) -> dict[str, int]:
    """Counts of sets without queries, and of entities without word vector,
    insert triples or training triples.
    """
    sets = where(experiment.immediate, model=experiment.initializers[0])
    # the queries of known_closed are those of known
    counted = sets[sets["scope"] != "known_closed"]
    empty = (counted["queries"] == 0).groupby(counted["scope"]).sum()
    with_triples = experiment.insert_triples[["size", "seed", "entity"]].drop_duplicates()
    return {
        **{
            f"sets without queries: {SCOPES[str(scope)]}": int(number)
            for scope, number in empty.items()
        },
        "entities without a word vector": int(experiment.coverage["served_by"].isna().sum()),
        "inserted entities without insert triples": len(experiment.novel) - len(with_triples),
        "known entities without training triples, over all sets": orphans(
            experiment.entities, experiment.triples, experiment.splits, experiment.novel
        ),
    }


def orphans(
    entities: pd.DataFrame, triples: pd.DataFrame, splits: pd.DataFrame, novel: pd.DataFrame
) -> int:
    """Number of known entities whose training triples all touch novel entities,
    summed over sizes and seeds.
    """
    ids = {name: number for number, name in enumerate(entities["entity"])}
    ends = np.stack([triples[end].map(ids) for end in ("head", "tail")], axis=1)
    lost = 0
    for (_, seed), cell in novel.groupby(["size", "seed"]):
        split = where(splits, seed=seed)
        listed = ends[split["triple"]]
        trained = ~np.isin(listed, cell["entity"]).any(1) & (split["split"] == "train").to_numpy()
        lost += len(np.setdiff1d(np.setdiff1d(listed, cell["entity"]), listed[trained]))
    return lost


def ties(experiments: Mapping[str, Experiment]) -> Rows:
    """Number of competitors tied with the answer right after insertion, by experiment,
    model and scope.
    """
    ties_of = {
        name: experiment.ties.groupby(["model", "scope"])["ties"]
        for name, experiment in experiments.items()
    }
    counts = {name: groups.sum() for name, groups in ties_of.items()}
    return [
        {_experiment(experiments): name, "model": label(model)}
        | {scope: int(counts[name].get((model, scope), 0)) for scope in ("all", "novel")}
        for name, experiment in experiments.items()
        for model in experiment.models
    ]


def fallbacks(experiments: Mapping[str, Experiment]) -> pd.DataFrame:
    """Number of inserted entities by experiment, initializer and fallback that was used."""
    inserted = {
        name: experiment.inserted.groupby(["model", "fallback"])
        for name, experiment in experiments.items()
    }
    rows = [
        (name, label(model), fallback, number)
        for name, groups in inserted.items()
        for model, fallback, number in groups.size()
        .reset_index()
        .itertuples(index=False, name=None)
    ]
    columns = [
        _experiment(experiments),
        "initializer",
        Column("fell back to", words=_FALLBACKS),
        "inserted entities",
    ]
    return pd.DataFrame(rows, columns=columns)


def _experiment(experiments: Mapping[str, Experiment]) -> Column:
    """A column with names of experiments in files and their titles on the page."""
    return Column(
        "experiment", words={name: experiment.title for name, experiment in experiments.items()}
    )


def departures(_: Results) -> Contents:
    """A list, in the template alone: differences from the paper,
    and decisions that the paper leaves open.
    """
    yield Content()
