"""Everything that a report is made of, read from the pipeline's tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from isi import paths, tables
from isi.errors import InputError
from isi.params import Params

JOINT = "joint"


@dataclass(frozen=True)
class Results:
    """The tables of one experiment, with entities by id where the tables have ids."""

    params: Params
    paper: Mapping[str, Any]
    definitions: pd.DataFrame
    observations: pd.DataFrame
    entities: pd.DataFrame
    triples: pd.DataFrame
    coverage: pd.DataFrame
    splits: pd.DataFrame
    novel: pd.DataFrame
    insert_triples: pd.DataFrame
    theta0_log: pd.DataFrame
    joint_log: pd.DataFrame
    #: ``tables.RUNS`` of every initializer and of the joint model, told apart by a column ``model``
    runs: pd.DataFrame
    #: ``tables.INSERTED`` and ``tables.TIES``, likewise
    inserted: pd.DataFrame
    ties: pd.DataFrame

    @property
    def initializers(self) -> list[str]:
        return self.params.insert.initializers

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.initializers, JOINT]

    @cached_property
    def at_once(self) -> pd.DataFrame:
        """Runs before any further training."""
        return self.runs[self.runs["epoch"] == 0]

    @cached_property
    def curve_size(self) -> int | None:
        """The first of ``curves.sizes`` that was run: the one that is drawn."""
        return next((size for size in self.params.curves.sizes if size in self.params.sessions.sizes), None)

    @cached_property
    def convergence(self) -> pd.DataFrame:
        """Epochs to convergence of each initializer and cell, in the scopes that ask for it (section 6.2).

        Columns model, scope, size, seed, epochs, converged, queries. Runs that never get there count
        as ``finetuning.max_epochs``; cells without queries are left out.
        """
        runs = self.runs[self.runs["scope"].isin(["all", "novel_heldout"])]
        key = ["scope", "size", "seed"]
        target = runs[runs["model"] == JOINT].set_index(key)["mrr_star"] - self.params.convergence.margin
        tried = runs[runs["model"] != JOINT].join(target.rename("target"), on=key).dropna(subset=["mrr_star"])
        reached = tried[tried["mrr_star"] >= tried["target"]].groupby(["model", *key], observed=True)["epoch"].min()
        cells = tried.groupby(["model", *key], observed=True)["queries"].first().to_frame()
        cells["converged"] = cells.index.isin(reached.index)
        cells["epochs"] = reached.reindex(cells.index).fillna(self.params.finetuning.max_epochs)
        return cells.reset_index()


def read(params: Params, experiment: str) -> Results:
    """Read the tables of an experiment.

    Raises:
        InputError: where one is missing or broken.
    """

    def table(path: Path, schema: Any) -> pd.DataFrame:
        frame = tables.read(path, schema)
        names = frame.select_dtypes("category").columns
        return frame.astype(dict.fromkeys(names, str))

    def of_models(path: Any, schema: Any, models: list[str]) -> pd.DataFrame:
        return pd.concat(table(path(experiment, model), schema).assign(model=model) for model in models)

    initializers = params.insert.initializers
    return Results(
        params=params,
        paper=_read_paper(paths.PAPER),
        definitions=_read_definitions(paths.DEFINITIONS),
        observations=table(paths.observations(experiment), tables.OBSERVATIONS),
        entities=table(paths.entities(experiment), tables.ENTITIES),
        triples=table(paths.triples(experiment), tables.TRIPLES),
        coverage=table(paths.coverage(experiment), tables.COVERAGE),
        splits=table(paths.splits(experiment), tables.SPLITS),
        novel=table(paths.novel(experiment), tables.NOVEL),
        insert_triples=table(paths.insert_triples(experiment), tables.INSERT_TRIPLES),
        theta0_log=table(paths.training_log(experiment, "theta0"), tables.TRAINING_LOG),
        joint_log=table(paths.training_log(experiment, JOINT), tables.TRAINING_LOG),
        runs=of_models(paths.runs, tables.RUNS, [*initializers, JOINT]),
        inserted=of_models(paths.inserted, tables.INSERTED, initializers),
        ties=of_models(paths.ties, tables.TIES, [*initializers, JOINT]),
    )


def _read_paper(path: Path) -> Mapping[str, Any]:
    try:
        values: Mapping[str, Any] = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except (OSError, YAMLError) as error:
        raise InputError(path, "", f"expected the paper's values in YAML ({error})") from error
    return values


def _read_definitions(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(path, keep_default_na=False)[["phrase", "definition"]]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(path, "", f"expected a CSV file with columns phrase and definition ({error})") from error
