"""Params restricted to the keys that a pipeline lists for a stage; all other keys are absent."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from isi.config import value_of
from isi.tables import paths
from stages.params import CONDITIONS, StageParams
from stages.pipeline import BEYOND_PARAMS, PIPELINES
from stages.stage import StageContext, context_of

parsed = cache(yaml.safe_load)  # cached, since parsing is slow


def listed(stage: str, names: Mapping[str, str]) -> dict[Path, list[str]]:
    """The keys of params that a pipeline lists for a stage with these arguments,
    by file of params.
    """
    stages: dict[str, Any] = {}
    for path in PIPELINES:
        stages |= parsed(path.read_text(encoding="utf-8"))["stages"]
    values = parsed(paths.PARAMS.read_text(encoding="utf-8"))

    def filled(part: re.Match[str]) -> str:
        matrix, _, item = part[1].partition(".")
        return names[item] if matrix == "item" else str(value_of(values, part[1]))

    keys = defaultdict[Path, list[str]](list)
    for entry in stages[stage].get("params", []):
        of_files = entry if isinstance(entry, dict) else {str(paths.PARAMS): [entry]}
        for file, patterns in of_files.items():
            keys[Path(file)] += [re.sub(r"\$\{([^}]+)\}", filled, key) for key in patterns]
    return keys


@dataclass(frozen=True)
class ListedParams(StageParams):
    """Params of which only the listed keys can be read."""

    keys: tuple[str, ...] = ()

    def read(self, key: str, kind: Any) -> Any:
        """As in ``StageParams``, without the parts that are not listed."""
        value = super().read(key, kind)
        if any(f"{key}.".startswith(f"{listed}.") for listed in self.keys):
            return value
        below = [each.removeprefix(f"{key}.") for each in self.keys if each.startswith(f"{key}.")]
        assert below, f"reads {key}, which is not listed"
        return restricted(value, below)

    def of(self, experiment: str) -> StageParams:
        """The params of an experiment: a section is listed if its own conditions are, too."""
        key, left = f"experiments.{experiment}", self.keys
        for section in CONDITIONS:
            if not {f"{key}.{section}", key, "experiments"} & {*self.keys}:
                left = tuple(each for each in left if each.partition(".")[0] != section)
        return replace(super().of(experiment), keys=left)  # type: ignore[call-arg]


def restricted_context(stage: str, names: Mapping[str, str]) -> StageContext:
    """The context of a stage with the params that are listed for it and ``compute``,
    and no others.
    """
    context, keys = context_of(stage, names), listed(stage, names)
    params, beyond = context.params, context.beyond
    return replace(
        context,
        params=ListedParams(params.values, params.file, keys=(*keys[paths.PARAMS], "compute")),
        beyond=ListedParams(beyond.values, beyond.file, keys=tuple(keys[BEYOND_PARAMS])),
    )


class Listed(dict[str, Any]):
    """A mapping restricted to listed keys; iteration raises ``AssertionError``,
    since it would read all keys.
    """

    def __iter__(self) -> Any:
        raise AssertionError(
            f"reads every key of a mapping of which {', '.join(super().keys())} are listed"
        )

    items = values = keys = __len__ = __iter__  # type: ignore[assignment]


def restricted(value: Any, keys: Iterable[str]) -> Any:
    """A section or a mapping restricted to dotted keys; with an empty key, it is unchanged."""
    within = defaultdict[str, list[str]](list)
    for key in keys:
        if not key:
            return value
        name, _, rest = key.partition(".")
        within[name].append(rest)
    if not isinstance(value, BaseModel):
        return Listed({name: restricted(value[name], rest) for name, rest in within.items()})
    section = type(value).model_construct()
    section.__dict__.clear()
    section.__dict__.update(
        {name: restricted(getattr(value, name), rest) for name, rest in within.items()}
    )
    return section
