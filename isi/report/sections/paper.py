"""The paper against this run: the numbers of both, and the causes of the gap."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import nan
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from isi import config
from isi.config import value_of
from isi.initializers.api import INITIALIZERS
from isi.report import charts, stats
from isi.report.data import Experiment, ModelRuns, Results, VariantRuns
from isi.report.figures import Chart, by_epoch
from isi.report.section import Content, Contents, Figures, Tables
from isi.report.sections import choices, queries, run
from isi.report.sections.finetuning import CURVES, interference_percent, table2
from isi.report.stats import Values, mean_of, where
from isi.report.tables import Column, Rows
from isi.report.words import BASELINE, JOINT, TEMPLATES, Names, isi, label

#: The rows of the table of all numbers; the file says how they are written.
ROWS = TEMPLATES / "paper_rows.yaml"
#: A number of this run agrees with the paper's if it differs by at most this share.
AGREES = 0.1


class Row(NamedTuple):
    """A number of the paper beside this run's; NaN: there is none."""

    place: str  #: in the paper
    what: str
    paper: float
    ours: float
    note: str  #: on ours

    @property
    def compared(self) -> str:
        return comparison(self.paper, self.ours)


def paper(results: Results) -> Contents:
    """The paper's numbers beside those of each standalone experiment; nothing without one."""
    if not results.standalone:
        return
    first, *others = results.standalone
    titles = {"paper": "", "this run": ""} | {other.name: other.title for other in others}
    columns = [
        Column(name, title=title, form=shown, any_size=True) for name, title in titles.items()
    ]
    tables = dict[str, Rows]()
    for name, kind in (("paper_against_this_run", "printed"), ("papers_other_numbers", "others")):
        tables[name] = Rows()
        every = [rows_of(results, experiment, kind) for experiment in (first, *others)]
        for row, *of_others in zip(*every, strict=True):
            numbers = [row.paper, row.ours, *(other.ours for other in of_others)]
            cells: dict[Any, Any] = {"where": row.place, "what": row.what}
            cells |= dict(zip(columns, numbers, strict=True))
            if kind == "printed":
                cells["this run is"] = row.compared
            else:
                cells["note"] = row.note
            tables[name].append(cells)
    rows = rows_of(results, first, "printed")
    counts = Counter(row.compared for row in rows)
    counts.pop("", None)
    methods = isi(first.initializers)
    gains = stats.values(stats.improvements(first.immediate, "all"))
    theirs = results.paper["immediate"]["improvement_over_xavier"]
    yield Content(
        {
            "others": others,
            "counts": counts,
            "methods": methods,
            "shapes": _shapes(results, first),
            "gains": (mean_of(theirs, methods), mean_of(gains, methods)),
        },
        tables,
        {"paper_against_this_run": _compared(rows, first.title)},
    )


def comparison(paper: float, ours: float) -> str:
    """Whether a number agrees with the paper's within ``AGREES`` of it, is larger or smaller;
    empty without both.
    """
    if np.isnan(paper) or np.isnan(ours):
        return ""
    if abs(ours - paper) <= AGREES * abs(paper):
        return "agrees"
    return "larger" if ours > paper else "smaller"


def _compared(rows: Sequence[Row], first: str) -> Chart:
    """The paper's results (rings) and ours (dots): a panel for each unit,
    a row for each printed result; ``first``: title of the first graph.
    """
    groups = dict[str, dict[str, tuple[float, float]]]()
    for panel, title in config.read(ROWS)["panels"].items():
        parts = [(row, *row.what.partition(": ")) for row in rows]
        listed = {
            whose: (row.paper, row.ours)
            for row, whose, _, about in parts
            if about == title.format(first=first)
        }
        if any(ours == ours for _, ours in listed.values()):
            groups[panel] = listed
    return charts.pairs(groups, ("paper", "this run"))


def _shapes(results: Results, experiment: Experiment) -> dict[str, Any]:
    """What shapes of the paper's results have become: Figures 2a and 2b, and the order of Table 2
    (equal numbers, as shown, are joined by "=").
    """
    epochs, models = experiment.epochs().get("all", {}), results.params.sweep.initializers
    theirs = {name: of["mean"] for name, of in results.paper["convergence"]["epochs"].items()}
    ours = {name: epochs[name] for name in theirs if name in epochs}
    shapes: dict[str, Any] = {"best": {}, "theirs": _order(theirs), "ours": _order(ours)}
    for swept, runs in results.analysis("sweep", experiment):
        of_runs = swept.converged(runs, ["model", "k"])
        means = choices.means_of(where(runs, epoch=0), of_runs, list(models))
        by_k = means[Column("MRR*", "all")].unstack("model").dropna(axis=1, how="all")
        of_epochs = means[Column("epochs", "all")]
        shapes["best"] = {str(name): int(k) for name, k in by_k.idxmax().items()}
        shapes["fall"] = float((by_k.max() - by_k.iloc[-1]).max())
        shapes["fewest"], shapes["most"] = float(of_epochs.min()), float(of_epochs.max())
    return shapes


def _order(values: Values) -> str:
    """Labels by ascending value; those of equal values, as shown, are joined."""
    by_value = dict[str, list[str]]()
    for name in sorted(values, key=lambda name: values[name]):
        by_value.setdefault(f"{values[name]:.1f}", []).append(label(name))
    return ", ".join(" = ".join(names) for names in by_value.values())


def own_graph(results: Results) -> Contents:
    """The standalone graphs side by side, and where ISI is significantly below the
    mean of an entity's kind.
    """
    graphs = [experiment for experiment in results.standalone if experiment.queries is not None]
    if len(graphs) < 2:
        return
    columns, compared = dict[Any, Any](), []
    for experiment in graphs:
        columns |= {
            Column("all", experiment.title): experiment.immediate_means("all"),
            Column("novel entity given", experiment.title): experiment.given_means,
            Column("mean", experiment.title, title="epochs"): experiment.epochs_means(),
        }
        if "kind_mean" in experiment.initializers and experiment is not graphs[0]:
            cells = experiment.by_grid_point("novel")
            below = [
                name
                for name in isi(experiment.initializers)
                if stats.difference(stats.by_seed(cells[name], cells["kind_mean"])).high < 0
            ]
            compared.append((experiment, below, "kind_mean"))
    models = dict.fromkeys(name for experiment in graphs for name in experiment.models)
    yield Content({"compared": compared}, {"standalone_graphs": stats.by_label(models, columns)})


def shown(value: float) -> str:
    """A number as text: whole, with one decimal from 1 up, else with two significant digits."""
    value = round(value, 6)  # a mean may miss a whole number by its last bits
    if float(value).is_integer():
        return f"{value:,.0f}"
    return f"{value:.1f}" if abs(value) >= 1 else f"{value:.2g}"


def rows_of(results: Results, experiment: Experiment, kind: str) -> list[Row]:
    """Numbers of the paper (``printed`` or ``others`` of ``ROWS``) beside those of one experiment;
    the rows do not depend on what was run.
    """
    theirs, ours = _papers(results.paper), _ours(results, experiment)
    labels = {name: label(name) for name in INITIALIZERS.names()}
    filled = {
        "answers": queries.TOP * len(results.params.affordances.entities),
        "first": results.standalone[0].title,
    }
    rows = list[Row]()
    for section, titles, key, *ours_key in config.read(ROWS)[kind]:
        named = value_of(theirs, key)
        names = list(named) if isinstance(named, dict) else [""]
        parts = titles if isinstance(titles, dict) else {"": titles}
        for name, (part, title) in product(names, parts.items()):
            place = "".join(f".{step}" for step in (name, part) if step)
            number = value_of(theirs, key + place)
            value, note = value_of(ours, (*ours_key, key)[0] + place), ""
            if isinstance(value, tuple):
                value, note = value
            text = (f"{labels.get(name, name)}: {title}" if name else title).format(**filled)
            of_paper, of_run = (nan if each is None else float(each) for each in (number, value))
            rows.append(Row(section, text, of_paper, of_run, note))
    return rows


def _papers(paper: Mapping[str, Any]) -> dict[str, Any]:
    """The paper's numbers, and what follows from them."""
    methods, saved = list(paper["indicators"]), paper["convergence"]["fewer_epochs_than_xavier"]
    gained, answers = paper["immediate"]["improvement_over_xavier"], paper["affordances"]
    moved_epochs = paper["transfer"]["epochs"]
    whose = dict.fromkeys(methods, "isi") | {BASELINE: "xavier"}
    return {
        **paper,
        "means": {"gain": mean_of(gained, methods), "fewer": saved.get("mean")},
        "fewer_epochs": {name: saved.get(name) for name in methods},
        "best_indicators": dict.fromkeys(methods, paper["indicators_degrade_after"]),
        "inferred_epochs": {
            name: epochs for name, epochs in moved_epochs.items() if name != BASELINE
        },
        "judged": {
            name: answers["judged"][who] | {"affordances": answers[who]}
            for name, who in whose.items()
        },
    }


def _ours(results: Results, experiment: Experiment) -> dict[str, Any]:
    """This run's numbers under the keys of the paper's."""
    methods, source = list(results.paper["indicators"]), experiment.settings.graph.source
    of_source = (other for other in results.extended if other.settings.graph.source == source)
    moved = next(of_source, None)
    gain = stats.values(stats.improvements(experiment.immediate, "all"))
    fewer = experiment.fewer_epochs("all")
    transfer = dict[str, Any]()
    if moved:
        transfer = {
            "all_queries": moved.mrr_star.get("all"),
            "novel_queries": moved.mrr_star.get("novel"),
            "drop": stats.values(interference_percent(moved.immediate)),
            "epochs": moved.epochs().get("all"),
        }
    return {
        "means": {"gain": mean_of(gain, methods), "fewer": mean_of(fewer, methods)},
        "fewer_epochs": fewer,
        "immediate": {"improvement_over_xavier": gain},
        "graph": _graph(results, experiment),
        "settings": {"finetuning_rate": results.params.finetuning.learning_rate},
        **_choices(results, experiment, moved),
        "convergence": {
            "epochs": _epochs(experiment, "all"),
            "heldout": _epochs(experiment, "novel_heldout"),
        },
        "transfer": transfer,
        "judged": _judged(results, [*methods, BASELINE], experiment, moved),
    }


def _graph(results: Results, experiment: Experiment) -> dict[str, Any]:
    """The size of the graph, and Table 1."""
    words, entities, triples = results.vocabulary, experiment.entities, experiment.triples
    kinds, bowls = entities["kind"].value_counts(), triples
    for end, names in words["bowls_in_cabinets"].items():
        bowls = bowls[bowls[end].isin(names)]
    observations = results.observed[experiment.settings.graph.source].observations
    counts = pd.DataFrame()
    if observations["scene"].notna().any():
        counts = run.table1(
            observations, results.paper["graph"]["median_per_environment"], words["relations"]
        )
        counts.columns = [getattr(column, "name", column) for column in counts.columns]
        counts = counts.set_index("room").rename(columns={"object types": "entities"})
    return {
        "relations": triples["relation"].nunique(),
        "entities": len(entities),
        "unique_triples": len(triples),
        "concepts": kinds.reindex(words["concepts"]).sum(),
        **{kind: kinds.get(kind, 0) for kind in words["kinds"]},
        "observations": triples["count"].sum(),
        "bowls_in_cabinets": bowls["count"].sum(),
        "median_per_environment": counts.to_dict("index"),
    }


def _choices(results: Results, experiment: Experiment, moved: Experiment | None) -> dict[str, Any]:
    """Best settings in cross-validation, each with a note, the rule,
    and the sizes that it picks.
    """
    choice = results.params.settings[0].model_dump()
    models = list(results.params.sweep.initializers)
    picked = dict[str, dict[str, Any]](training={}, indicators={}, best_indicators={})
    for _, folds in results.analysis("cross_validation", experiment, moved):
        picked["training"] = {name: choices.best(folds, choice, name) for name in choice}
    for swept, runs in results.analysis("sweep", experiment, moved):
        epochs = swept.converged(runs, ["model", "k"])
        means = choices.means_of(where(runs, epoch=0), epochs, models)
        mrr_star = means[Column("MRR*", "all")].dropna()
        picked["indicators"] = choices.picked_sizes(means)
        for model in mrr_star.index.unique("model"):
            picked["best_indicators"][model] = int(mrr_star[model].idxmax())
    return picked


def _epochs(experiment: Experiment, scope: str) -> dict[Any, Any]:
    """Table 2 in one scope, by model: mean and standard deviation of the epochs to convergence."""
    rows = where(experiment.convergence, scope=scope)
    return (
        rows.groupby("model")["epochs"]
        .agg(["mean", "std"])
        .set_axis(["mean", "deviation"], axis=1)
        .to_dict("index")
    )


def _judged(results: Results, models: Names, *experiments: Experiment | None) -> dict[str, Any]:
    """Table 3 by model: how many of the answers shown are affordances, and how many are plausible,
    unlikely, wrong.
    """
    entities, afforded = results.params.affordances.entities, results.vocabulary["afforded"]
    judged = dict[str, Any]()
    for experiment, ranks in results.analysis("affordances", *experiments):
        answers = queries.AffordanceAnswers.of(experiment)
        for name in models:
            if name in set(ranks["model"]):
                judged[name] = answers.judged(name, entities, afforded)
    return judged


#: The name of a row, MRR* over all queries right after insertion, and epochs to convergence, by
#: model.
Line = tuple[str, Values, Values]


def causes(results: Results) -> Contents:
    """Causes of the gap to the paper: a row for each changed setting;
    Figure 3b and Table 2 for full curves.
    """
    variants, first = results.variants_of("causes"), next(iter(results.standalone), None)
    methods = isi(first.finetuned) if first else []
    if (
        not variants
        or not first
        or first.curve_size is None
        or BASELINE not in first.finetuned
        or not methods
    ):
        return
    paper, margin = results.paper["convergence"]["epochs"], results.params.convergence.margin
    xavier, of_isi = Column(label(BASELINE), "epochs"), Column("ISI", "epochs")
    rows = [_row(methods, *line) for line in _lines(results, first, variants)]
    epochs = {name: numbers["mean"] for name, numbers in paper.items()}
    theirs = {
        "row": "the paper",
        "gain %": mean_of(results.paper["immediate"]["improvement_over_xavier"], methods),
        xavier: epochs.get(BASELINE, nan),
        of_isi: mean_of(epochs, methods),
    }
    most_gain, slowest = (
        rows[pd.DataFrame(rows)[name].fillna(-1).to_numpy().argmax()] for name in ("gain %", xavier)
    )
    curves = [runs for runs in variants if runs.variant.full_curves]
    numbers = {
        "methods": methods,
        "curves": curves,
        "gain": [row["gain %"] for row in (theirs, rows[0], most_gain)],
        "of_gain": most_gain["row"],
        "epochs": [row[xavier] for row in (theirs, rows[0], slowest)],
        "of_epochs": slowest["row"],
        "isi_epochs": [row[of_isi] for row in (slowest, theirs)],
    }
    tables, figures = Tables(causes=[*rows, theirs]), Figures()
    for runs in curves:
        tables[f"convergence_{runs.id}"] = table2(runs.convergence, runs.initializers, paper)
        drawn = by_epoch(runs.runs, runs.initializers, CURVES, margin=margin)
        figures[f"curves_{runs.id}"] = drawn
    yield Content(numbers, tables, figures)


def _row(methods: Names, name: str, now: Values, later: Values) -> dict[Any, Any]:
    """A row of the table of causes: Xavier, and the mean of ISI."""
    means = [[of.get(method, nan) for method in methods] for of in (now, later)]
    of_isi, epochs = (float(np.mean(of_methods)) for of_methods in means)
    base = now.get(BASELINE, nan)
    return {
        "row": name,
        "joint": now.get(JOINT, nan),
        label(BASELINE): base,
        "ISI": of_isi,
        "gain %": 100 * (of_isi / base - 1),
        Column(label(BASELINE), "epochs"): later.get(BASELINE, nan),
        Column("ISI", "epochs"): epochs,
    }


def _lines(results: Results, first: Experiment, variants: Sequence[VariantRuns]) -> Iterator[Line]:
    """Lines of the first graph: two sizes, entity MRR*, filter ``true``;
    then of variants and of other graphs.
    """
    size, largest = first.curve_size, max(first.settings.sessions.sizes)
    main = first.of_size(size)
    yield _line(f"this run, {size} novel entities", main)
    if largest != size:
        share = 100 * largest / len(first.entities)
        yield _line(f"{largest} novel entities, {share:.0f} % of all", first.of_size(largest))
    yield "entity prediction alone", _line("", main, "mrr_star_entity")[1], {}
    if main.queries is not None:
        true = where(main.queries, scope="all", filter="true")
        means = stats.means(stats.combined(true, ["model", "size", "seed"]), "mrr_star")
        yield "all true triples left out of the candidates", means, {}
    for runs in variants:
        title, now, later = _line(f"{runs.variant.title} ({runs.title})", runs)
        yield title, now, later if runs.variant.finetuned else {}
    for experiment in results.standalone[1:]:
        if size in experiment.settings.sessions.sizes:
            yield _line(f"{experiment.title}, {size} novel entities", experiment.of_size(size))


def _line(title: str, runs: ModelRuns, column: str = "mrr_star") -> Line:
    now, later = (where(rows, scope="all") for rows in (runs.immediate, runs.convergence))
    return title, stats.means(now, column), stats.means(later, "epochs", scale=1)
