"""Values of a params file, each read and checked as the type that its reader names.

A stage reads the keys that its entry in ``dvc.yaml`` lists. What one section says of another is
checked by ``stages/check_params.py``, which `make` runs before the pipeline.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from isi import config
from isi.config import Seed
from isi.errors import InputError
from isi.tables import paths
from stages import pipeline

#: Sections that an experiment may replace for itself.
CONDITIONS = ("negatives", "training", "finetuning")
#: Sections that a variant may change.
CHANGEABLE = (
    "embedding",
    "models",
    "negatives",
    "training",
    "words",
    "finetuning",
    "convergence",
    "initializers",
)


@dataclass(frozen=True)
class StageParams:
    """The values of a params file."""

    values: Mapping[str, Any]
    file: Path = paths.PARAMS
    #: dotted keys whose values stand at another key, that of an experiment's own conditions
    replaced: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def load(cls, file: Path = paths.PARAMS) -> StageParams:
        """The values of a file; ``InputError`` if it is no YAML mapping."""
        return cls(pipeline.read(file), file)

    def read(self, key: str, kind: Any) -> Any:
        """The value at a dotted key, as the type ``kind``; ``InputError`` names the key that is
        missing or wrong.
        """
        section: Any = self.values
        for part in key.split("."):
            if not isinstance(section, Mapping) or part not in section:
                raise InputError(self.file, key, "Field required")
            section = section[part]
        try:
            return config.check(section, kind, key, self.file)
        except InputError as error:
            place = self.replaced.get(error.place, error.place)
            raise InputError(error.file, place, error.message) from error

    @property
    def seed(self) -> int:
        """The root of every random stream."""
        root: int = self.read("seed", Seed)
        return root

    def of(self, experiment: str) -> StageParams:
        """These params with an experiment's own conditions in place of the general ones;
        ``InputError`` where one of both is no mapping.
        """
        changed, replaced = dict(self.values), dict[str, str]()
        for section in CONDITIONS:
            key = f"experiments.{experiment}.{section}"
            conditions = config.value_of(self.values, key)
            if conditions is None:
                continue
            general = config.check(self.values.get(section), dict[str, Any], section, self.file)
            conditions = config.check(conditions, dict[str, Any], key, self.file)
            changed[section] = {**general, **conditions}
            replaced |= {f"{section}.{name}": f"{key}.{name}" for name in conditions}
        return replace(self, values=changed, replaced=replaced)

    def changed(self, changes: Mapping[str, Any]) -> StageParams:
        """Params with new values at dotted keys; ``InputError`` for a key outside
        ``CHANGEABLE``.
        """
        values = deepcopy(dict(self.values))
        for key, value in changes.items():
            section, _, within = key.partition(".")
            if section not in CHANGEABLE or not within:
                raise InputError("", key, f"expected a dotted key below {', '.join(CHANGEABLE)}")
            place: Any = values
            *parents, last = key.split(".")
            for parent in parents:
                place = place.setdefault(parent, {})
                if not isinstance(place, dict):
                    raise InputError("", key, f"expected {parent} to be a mapping, got a value")
            place[last] = value
        return replace(self, values=values)
