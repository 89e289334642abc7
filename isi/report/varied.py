"""What lies beyond the paper: experiments under other conditions, where the second pipeline has run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from isi.base import paths, tables
from isi.learning.convergence import epochs_to_convergence
from isi.params import Params
from isi.report import parts
from isi.report.models import JOINT, label
from isi.report.statistics import HIGH, LOW, over_seeds
from isi.studies.variants import Variant, load

_CELL = ["experiment", "model", "size", "seed"]


@dataclass(frozen=True, eq=False)
class Varied:
    """A variant, and what became of it."""

    how: Variant
    #: ``tables.VARIANTS`` and ``tables.VARIANTS_ASKED``
    runs: pd.DataFrame
    asked: pd.DataFrame

    @property
    def models(self) -> list[str]:
        """The initializers, then the joint model."""
        return [*self.how.initializers, JOINT]

    def at_once(self, experiment: str, scope: str) -> pd.DataFrame:
        """Runs right after insertion."""
        runs = self.runs
        return runs[(runs["experiment"] == experiment) & (runs["scope"] == scope) & (runs["epoch"] == 0)]

    @cached_property
    def about(self) -> pd.DataFrame:
        """The entity half of scope novel where the novel entity is asked about, a row for each model and cell."""
        rows = self.asked[(self.asked["scope"] == "novel") & (self.asked["filter"] == "learned")]
        return parts.mrr_star(rows[(rows["hidden"] != "relation") & (rows["novel"] == "given")], _CELL)

    def about_in(self, experiment: str) -> pd.DataFrame:
        """The same of one experiment."""
        return self.about[self.about["experiment"] == experiment]

    def convergence(self, experiment: str, params: Params) -> pd.DataFrame:
        """Epochs to convergence of each initializer and cell."""
        own = self.runs[self.runs["experiment"] == experiment]
        most = int(self.how.changes.get("finetuning.max_epochs", params.finetuning.max_epochs))
        joint = own["model"] == JOINT
        return epochs_to_convergence(own[~joint], own[joint], params.convergence.margin, most, ["model"])


def read() -> dict[str, Varied]:
    """Every variant of the second pipeline that has run, in its order.

    Raises:
        InputError: where its params or a table are broken.
    """
    ran = {name: how for name, how in load().items() if paths.variant_asked(name).exists()}
    return {
        name: Varied(
            how, _plain(tables.read(paths.variant(name), tables.VARIANTS)),
            _plain(tables.read(paths.variant_asked(name), tables.VARIANTS_ASKED)),
        )
        for name, how in ran.items()
    }  # fmt: skip


def _plain(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.astype(dict.fromkeys(frame.select_dtypes("category").columns, str))


def group(varied: Mapping[str, Varied], name: str) -> dict[str, Varied]:
    """The variants of one group."""
    return {key: one for key, one in varied.items() if one.how.group == name}


def by_model(rows: pd.DataFrame, column: str, models: Sequence[str], scale: float = 100.0) -> dict[str, float]:
    """Mean of a column for each model, with its interval over seeds, under the models' labels: part of a row."""
    means = over_seeds(rows, ["model"], {column: ""}, scale)
    return {
        f"{label(model)}{end}": float(means.loc[model, end])
        for model in models
        if model in means.index
        for end in ("", LOW, HIGH)
    }
