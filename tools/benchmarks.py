"""Turn the results of ``make benchmark`` into the tables and the figure of docs/benchmarks."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from isi.report.figures import STYLE
from isi.training.batches import DENSE_LIMIT

FOLDER = Path(__file__).parent.parent / "docs" / "benchmarks"
COLOURS = {"tables": "#d55e00", "lists": "#0072b2"}


def machine(results: dict[str, Any]) -> str:
    """What the benchmarks ran on, in a line."""
    info = results["machine_info"]
    versions = ", ".join(f"{name} {number}" for name, number in info["versions"].items())
    python = f"Python {info['python_version']}"
    return f"{info['cpu']['brand_raw']}, {info['cores']} cores, {info['system']}; {python}, {versions}.\n"


def training(rows: pd.DataFrame) -> pd.DataFrame:
    """Medians over epochs; ratios are of triples scored in a second."""
    rate = rows["scored"] / rows["median"]
    of = dict(zip(rows["library"], rate, strict=True))
    return pd.DataFrame({
        "": rows["library"] + ", " + rows["model"],
        "negatives": rows["negatives"],
        "models": rows["models"].astype(int).astype(str),
        "ms per model and epoch": _figures(1000 * rows["median"] / rows["models"]),
        "million triples scored per second": _figures(rate / 1e6),
        "times TorchKGE": _figures(rate / of["TorchKGE"]),
        "times PyKEEN": _figures(rate / of["PyKEEN"]),
    })  # fmt: skip


def ranking(rows: pd.DataFrame) -> pd.DataFrame:
    """Medians over repeats; ratios are of triples asked about in a second."""
    rate = rows["triples"] / rows["median"]
    theirs = float(rate[rows["what"].str.startswith("PyKEEN")].iloc[0])
    return pd.DataFrame({
        "": rows["what"],
        "triples": rows["triples"].map("{:,.0f}".format),
        "ms": _figures(1000 * rows["median"]),
        "thousand triples per second": _figures(rate / 1e3),
        "times PyKEEN": _figures(rate / theirs),
    })  # fmt: skip


def growth(rows: pd.DataFrame) -> pd.DataFrame:
    """An epoch and a ranking on graphs of growing size, by form."""
    shown = rows.sort_values(["entities", "form"], ascending=[True, False])
    return pd.DataFrame({
        "entities": shown["entities"].map("{:,.0f}".format),
        "triples": shown["triples"].map("{:,.0f}".format),
        "batches as": shown["form"],
        "s per epoch": _figures(shown["epoch_seconds"]),
        "µs per observation": _figures(1e6 * _per_observation(shown)),
        "peak MiB of training": shown["training_mib"].map("{:,.0f}".format),
        "s to rank up to 200 triples": _figures(shown["ranking_seconds"]),
        "peak MiB with ranking": shown["peak_mib"].map("{:,.0f}".format),
    })  # fmt: skip


def mining(rows: pd.DataFrame) -> pd.DataFrame:
    """Mining in one process."""
    return pd.DataFrame({
        "houses": rows["houses"].map("{:,.0f}".format),
        "observations": rows["observations"].map("{:,.0f}".format),
        "s": _figures(rows["seconds"]),
        "peak MiB": rows["peak_mib"].map("{:,.0f}".format),
    })  # fmt: skip


def insert(rows: pd.DataFrame) -> pd.DataFrame:
    """``isi.insert`` on one thread, three triples told of each new entity; medians."""
    return pd.DataFrame({
        "known entities": rows["entities"].map("{:,.0f}".format),
        "new ones": rows["new"].map("{:,.0f}".format),
        "initializer": rows["initializer"],
        "ms": _figures(1000 * rows["seconds"]),
        "peak MiB": rows["peak_mib"].map("{:,.0f}".format),
    })  # fmt: skip


def umls(rows: pd.DataFrame) -> pd.DataFrame:
    """Mean reciprocal rank of families beside PyKEEN's."""
    return pd.DataFrame({
        "": rows["model"],
        "test triples": rows["triples"].map("{:,.0f}".format),
        "isi: MRR": rows["isi"].map("{:.3f}".format),
        "PyKEEN: MRR": rows["pykeen"].map("{:.3f}".format),
    })  # fmt: skip


def thor_u(rows: pd.DataFrame) -> pd.DataFrame:
    """MRR and Hits@10 of families beside their authors', in percent."""
    shown = {"": rows["model"]}
    for place, measure in enumerate(("MRR", "Hits@10")):
        for column, whose in (("published", "published"), ("valid", "isi, validation"), ("test", "isi, test")):
            shown[f"{measure}: {whose}"] = rows[column].map(lambda both, place=place: f"{100 * both[place]:.1f}")
    return pd.DataFrame(shown)


def crossing(rows: pd.DataFrame) -> float:
    """Possible triples of a graph on which the two forms cost the same (log-log interpolation)."""
    both = rows.assign(cost=_per_observation(rows)).pivot(index="entities", columns="form", values="cost").dropna()
    ahead = np.log((both["tables"] / both["lists"]).to_numpy())
    last = np.flatnonzero(ahead < 0)[-1]
    about = slice(last, last + 2)
    return relations(rows) * float(np.exp(np.interp(0, ahead[about], np.log(both.index[about])))) ** 2


def relations(rows: pd.DataFrame) -> int:
    """Of the graphs that grow, which all have the same."""
    return int(rows["relations"].iloc[0])


def scaling(rows: pd.DataFrame) -> Figure:
    """Time and memory against entities."""
    canvas = Figure(figsize=(8, 3.4), layout="constrained")
    left, right = canvas.subplots(1, 2)
    for form, part in rows.sort_values("entities").groupby("form", sort=False):
        how = {"color": COLOURS[str(form)], "marker": "o", "ms": 3, "label": f"batches as {form}"}
        left.loglog(part["entities"], 1e6 * _per_observation(part), **how)
        right.semilogx(part["entities"], part["training_mib"], **how)
    switches = (DENSE_LIMIT, "--", "where batches become lists"), (crossing(rows), ":", "where both cost the same")
    for axes in (left, right):
        for cells, line, what in switches:
            axes.axvline((cells / relations(rows)) ** 0.5, color="black", lw=0.8, ls=line, label=what)
        axes.set_xlabel("entities (ten triples each)")
    left.set(title="an epoch of one model", ylabel="µs per observation")
    right.set(title="peak memory of the process", ylabel="MiB", ylim=(0, None))
    canvas.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return canvas


def facts(rows: pd.DataFrame) -> pd.DataFrame:
    """What benchmarks say of themselves: for those without a table of their own."""
    shown = rows.drop(columns="median")
    return pd.DataFrame({
        name.replace("_", " "): _figures(shown[name]) if shown[name].dtype == float else shown[name].astype(str)
        for name in shown
    })  # fmt: skip


def _per_observation(rows: pd.DataFrame) -> pd.Series:
    return rows["epoch_seconds"] / rows["observations"]


def _figures(values: pd.Series) -> pd.Series:
    """Three figures, none lost."""
    return values.map(lambda value: f"{value:,.0f}" if value >= 100 else f"{value:#.3g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, help="JSON of pytest-benchmark")
    results = json.loads(parser.parse_args().results.read_text(encoding="utf-8"))
    groups = {
        str(name): pd.DataFrame([{**run["extra_info"], "median": run["stats"]["median"]} for run in runs])
        for name, runs in pd.Series(results["benchmarks"]).groupby([run["group"] for run in results["benchmarks"]])
    }
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "machine.md").write_text(machine(results), encoding="utf-8")
    tables = {
        "training": training,
        "ranking": ranking,
        "growth": growth,
        "insert": insert,
        "mining": mining,
        "umls": umls,
        "thor_u": thor_u,
    }
    for name, rows in groups.items():
        shown = tables.get(name, facts)(rows)
        text = shown.to_markdown(
            index=False, disable_numparse=True, colalign=["left", *["right"] * (shown.shape[1] - 1)]
        )
        (FOLDER / f"{name}.md").write_text(text + "\n", encoding="utf-8")
        print(f"\n{text}")
    if "growth" in groups:
        _grown(groups["growth"])


def _grown(rows: pd.DataFrame) -> None:
    """Where tables and lists cost the same, and the figure."""
    even = float(f"{crossing(rows):.2g}")
    same = f"Tables and lists cost the same on a graph of {even:,.0f} possible triples"
    switch = f"{same}; batches become lists above {DENSE_LIMIT:,}."
    (FOLDER / "switch.md").write_text(switch + "\n", encoding="utf-8")
    print(f"\n{switch}")
    with mpl.rc_context(STYLE):
        canvas = scaling(rows)
        canvas.savefig(FOLDER / "scaling.svg", metadata={"Date": None})
        canvas.savefig(FOLDER / "scaling.png")


if __name__ == "__main__":
    main()
