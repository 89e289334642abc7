"""Turn the results of ``make benchmark`` into the tables and the figure of docs/benchmarks."""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from isi.config import read
from isi.tables import paths
from isi.training.batches import DENSE_LIMIT
from tools.docs import BENCHMARKS, record, this_run, write_table
from tools.figures import STYLE

COLOURS = {"tables": "#d55e00", "lists": "#0072b2"}
#: In a cell without a number.
NONE = "–"
#: Trainings are alike that have these in common; the library may be another one.
ALIKE = ["family", "negatives", "models"]


@dataclass(frozen=True)
class Size:
    """Of a graph and its vectors."""

    entities: int
    relations: int
    triples: int
    dimension: int


#: Wikidata5M's, with vectors of 100 numbers.
LARGE = Size(4_600_000, 822, 20_000_000, 100)


def _count(values: pd.Series) -> pd.Series:
    return values.map("{:,.0f}".format)


def _figures(values: pd.Series) -> pd.Series:
    """Numbers as text, with three significant figures, or whole from 100 on; ``NONE`` for NaN."""
    return values.map(_in_figures)


def _in_figures(value: float) -> str:
    if np.isnan(value):
        return NONE
    return f"{value:,.0f}" if value >= 100 else f"{value:#.3g}"


def training(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """CPU time of an epoch, median over epochs. Expected negatives are not scored one by one.

    Another library is compared with the row of ``isi`` that is alike: the same family, as many
    sampled negatives, one model. What a stack or expected negatives add is compared with one model
    of ``isi``, of the same family, with sampled negatives.
    """
    seconds = rows["median"] / rows["models"]
    scored = rows["scored"].astype(float)
    return {
        "": rows["library"] + ", " + rows["model"],
        "negatives": rows["negatives"],
        "models": rows["models"].astype(int).astype(str),
        "ms per model and epoch": _figures(1000 * seconds),
        "million triples scored per second": _figures(scored / rows["median"] / 1e6),
        "times as fast as PyKEEN": _figures(_against(rows, "PyKEEN")),
        "times as fast as TorchKGE": _figures(_against(rows, "TorchKGE")),
        "times as fast as one model, sampled": _figures(_against_one_model(rows) / seconds),
    }


def _against(rows: pd.DataFrame, library: str) -> pd.Series:
    """How many times as fast each training is as the one of a library that is alike;
    NaN if there is none.
    """
    theirs = rows[rows["library"] == library].set_index(ALIKE)["median"]
    alike = theirs.reindex(pd.MultiIndex.from_frame(rows[ALIKE]))
    return pd.Series(alike.to_numpy(), rows.index) / rows["median"]


def _against_one_model(rows: pd.DataFrame) -> pd.Series:
    """Seconds of one model of ``isi``, of the family of each row, with as many sampled negatives;
    NaN for other libraries.
    """
    as_sampled = rows["negatives"].str.replace("expected", "sampled")
    ours = rows["library"] == "isi"
    alone = rows[ours & (rows["models"] == 1) & (rows["negatives"] == as_sampled)]
    seconds = alone.set_index(["family", "negatives"])["median"]
    sampled = seconds.reindex(pd.MultiIndex.from_arrays([rows["family"], as_sampled]))
    return pd.Series(sampled.to_numpy(), rows.index).where(ours)


def ranking(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """Ranking, median over repeats; ratios are of triples ranked per second."""
    rate = rows["triples"] / rows["median"]
    return {
        "": rows["what"],
        "triples": _count(rows["triples"]),
        "ms": _figures(1000 * rows["median"]),
        "thousand triples per second": _figures(rate / 1e3),
        "times PyKEEN": _figures(rate / float(rate[rows["what"].str.startswith("PyKEEN")].iloc[0])),
    }


def growth(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """Time and memory of an epoch and of a ranking,
    by number of entities and form of the batches.
    """
    rows = rows.sort_values(["entities", "form"], ascending=[True, False])
    return {
        "entities": _count(rows["entities"]),
        "triples": _count(rows["triples"]),
        "batches as": rows["form"],
        "s per epoch": _figures(rows["epoch_seconds"]),
        "µs per observation": _figures(1e6 * _per_observation(rows)),
        "peak MiB of training": _count(rows["training_mib"]),
        "s to rank up to 200 triples": _figures(rows["ranking_seconds"]),
        "peak MiB with ranking": _count(rows["peak_mib"]),
    }


def mining(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """Time and memory of mining houses in one process, by number of houses."""
    return {
        "houses": _count(rows["houses"]),
        "observations": _count(rows["observations"]),
        "s": _figures(rows["seconds"]),
        "peak MiB": _count(rows["peak_mib"]),
    }


def insert(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """Median time of one core and memory of an insertion,
    with ten insert triples for each new entity.
    """
    return {
        "known entities": _count(rows["entities"]),
        "known triples": _count(rows["triples"]),
        "new entities": _count(rows["new"]),
        "by": rows["what"],
        "numbers in a vector": rows["dimension"].astype(str),
        "ms": _figures(1000 * rows["seconds"]),
        "peak MiB": _count(rows["peak_mib"]),
    }


def live(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """Median wall time of a change of a home or a query to it;
    ratios are of ``isi.insert`` alone.
    """
    (alone,) = rows["median"][rows["what"] == "isi.insert"]
    return {
        "": rows["what"],
        "ms": _figures(1000 * rows["median"]),
        "per second": _count(1 / rows["median"]),
        "of isi.insert": _figures(rows["median"] / alone),
    }


def umls(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """MRR of each model, trained by isi and by PyKEEN."""
    measured = {
        f"{name}: MRR": rows[name.lower()].map("{:.3f}".format) for name in ("isi", "PyKEEN")
    }
    return {"": rows["model"], "test triples": _count(rows["triples"]), **measured}


def thor_u(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """MRR and Hits@10 of each model in per cent, as published and as measured by isi."""
    shown = {"": rows["model"]}
    for place, measure in enumerate(("MRR", "Hits@10")):
        for column, whose in (
            ("published", "published"),
            ("valid", "isi, validation"),
            ("test", "isi, test"),
        ):
            shown[f"{measure}: {whose}"] = rows[column].map(
                lambda both, place=place: f"{100 * both[place]:.1f}"
            )
    return shown


def updates(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """CPU time of an update by one observation, by number of entities; medians over epochs."""
    return {
        "entities": _count(rows["entities"]),
        "observations": _count(rows["observations"]),
        "µs per update, compiled": _figures(1e6 * rows["median"] / rows["observations"]),
        "µs per update, batches of one": _figures(1e6 * rows["plain"]),
        "times as fast": _figures(rows["plain"] * rows["observations"] / rows["median"]),
    }


def facts(rows: pd.DataFrame) -> dict[str, pd.Series]:
    """All columns but the median, of groups that ``TABLES`` does not list."""
    return {
        name.replace("_", " "): _figures(values) if values.dtype == float else values.astype(str)
        for name, values in rows.drop(columns="median").items()
    }


TABLES = {
    "training": training,
    "ranking": ranking,
    "growth": growth,
    "insert": insert,
    "mining": mining,
    "umls": umls,
    "thor_u": thor_u,
    "live": live,
    "updates": updates,
}


def crossing(rows: pd.DataFrame) -> float:
    """R · E² at which batches as tables and as lists take the same time
    (log-log interpolation over E).
    """
    both = (
        rows.assign(cost=_per_observation(rows))
        .pivot(index="entities", columns="form", values="cost")
        .dropna()
    )
    ahead = np.log((both["tables"] / both["lists"]).to_numpy())
    last = np.flatnonzero(ahead < 0)[-1]
    about = slice(last, last + 2)
    entities = float(np.exp(np.interp(0, ahead[about], np.log(both.index[about]))))
    return int(rows["relations"].iloc[0]) * entities**2


def scaling(rows: pd.DataFrame) -> Figure:
    """A figure of time per observation and of peak memory against the number of entities."""
    canvas = Figure(figsize=(8, 3.4), layout="constrained")
    left, right = canvas.subplots(1, 2)
    for form, part in rows.sort_values("entities").groupby("form", sort=False):
        style = {"color": COLOURS[str(form)], "marker": "o", "ms": 3, "label": f"batches as {form}"}
        left.loglog(part["entities"], 1e6 * _per_observation(part), **style)
        right.semilogx(part["entities"], part["training_mib"], **style)
    switches = (
        (DENSE_LIMIT, "--", "where batches become lists"),
        (crossing(rows), ":", "where both cost the same"),
    )
    for axes in (left, right):
        for cells, line, label in switches:
            axes.axvline(
                (cells / rows["relations"].iloc[0]) ** 0.5,
                color="black",
                lw=0.8,
                ls=line,
                label=label,
            )
        axes.set_xlabel("entities (ten triples each)")
    left.set(title="an epoch of one model", ylabel="µs per observation")
    right.set(title="peak memory of the process", ylabel="MiB", ylim=(0, None))
    canvas.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return canvas


def _per_observation(rows: pd.DataFrame) -> pd.Series:
    return rows["epoch_seconds"] / rows["observations"]


def large(folder: Path = BENCHMARKS) -> pd.DataFrame:
    """What a graph of the size ``LARGE`` takes: measured, by arithmetic, or estimated from the
    tables of smaller graphs.
    """
    cells, parameters = LARGE.relations * LARGE.entities, LARGE.entities * LARGE.dimension
    rows = [
        ("the table of vectors and Adagrad's sums", _bytes(8 * parameters), "8 · E · d bytes"),
        (
            "batches of all negatives (`isi train`, the experiments): the data of a model alone",
            _bytes(12 * cells),
            "12 · R · E bytes",
        ),
    ]
    growth = _read(folder, "growth").query("`batches as` == 'lists'").set_index("entities")
    batch = read(paths.PARAMS)["training"]["batch_size"]
    per_step = growth["µs per observation"] * batch / 1e6
    (less, more), steps = per_step.index[-2:], LARGE.triples / batch
    slope = (per_step[more] - per_step[less]) / (more - less)
    step = per_step[more] + slope * (LARGE.entities - more)
    rows += [
        (
            f"a step of {batch:,} triples whose gradient touches the whole table",
            _time(step),
            f"a line through {less:,} and {more:,} entities of `growth.csv`",
        ),
        ("an epoch of such steps", _time(step * steps), "the same, T triples"),
    ]
    inserted = _read(folder, "insert").query(f"`known entities` == {LARGE.entities}")
    for _, row in inserted.iterrows():
        measured = f"{row['ms'] / 1e3:.1f} s, {row['peak MiB'] / 1024:.1f} GiB"
        rows.append(("one entity by MAP, the table in its file", measured, "`insert.csv`"))
    return pd.DataFrame(rows, columns=["what", "figure", "from"])


def _read(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_csv(folder / f"{name}.csv", thousands=",")


def _bytes(number: int) -> str:
    return f"{number / 1e9:.2g} GB"


def _time(seconds: float) -> str:
    """Seconds in the largest unit of which there is at least one and a half."""
    for unit, length in (("days", 86_400), ("hours", 3_600), ("minutes", 60)):
        if seconds >= 1.5 * length:
            return f"{float(f'{seconds / length:.2g}'):g} {unit}"
    return f"{seconds:.2g} s"


def run_of(results: dict[str, Any]) -> dict[str, str]:
    """This run, with the versions of packages from the JSON of pytest-benchmark."""
    run, versions = this_run(), results["machine_info"]["versions"]
    packages = "".join(f", {name} {number}" for name, number in versions.items())
    return run | {"machine": run["machine"] + packages}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, help="JSON of pytest-benchmark")
    results = json.loads(parser.parse_args().results.read_text(encoding="utf-8"))
    groups: dict[str, list[dict[str, Any]]] = {}
    for run in results["benchmarks"]:
        groups.setdefault(run["group"], []).append(
            {**run["extra_info"], "median": run["stats"]["median"]}
        )
    for name, measured in groups.items():
        write_table(name, pd.DataFrame(TABLES.get(name, facts)(pd.DataFrame(measured))))
    record(run_of(results), sorted(groups))
    write_table("large", large())
    if "growth" in groups:
        rows = pd.DataFrame(groups["growth"])
        same = (
            "Tables and lists cost the same on a graph of "
            f"{float(f'{crossing(rows):.2g}'):,.0f} possible triples"
        )
        switch = f"{same}; batches become lists above {DENSE_LIMIT:,}.\n"
        (BENCHMARKS / "switch.md").write_text(switch, encoding="utf-8")
        print(f"\n{switch}")
        with mpl.rc_context(STYLE):
            canvas = scaling(rows)
            canvas.savefig(BENCHMARKS / "scaling.png")


if __name__ == "__main__":
    main()
