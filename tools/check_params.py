"""Check all of params.yaml and beyond/params.yaml: DVC looks only at the keys that its stages name."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Mapping

from isi.analyses import variants
from isi.analyses.other_graphs import Beyond
from isi.analyses.other_graphs import load as load_beyond
from isi.analyses.variants import Variant
from isi.config import check, distinct, read
from isi.errors import InputError, meant
from isi.initializers.api import INITIALIZERS, options_of
from isi.params import Params, load
from isi.pipeline import declared
from isi.sources import settings_of
from isi.stage import StageContext
from isi.tables import paths


def check_beyond(params: Params) -> None:
    """See that variants and graphs have what there is, with options and params that these take.

    Raises:
        InputError: where one is not.
    """
    beyond = load_beyond()
    for name, variant in beyond.variants.items():
        _check_names(variant.experiments, params.experiments, f"variants.{name}.experiments")
        _check(params, variant, f"variants.{name}", "vary", {"variant": name})
    titles = [one.title for one in (*params.experiments.values(), *beyond.graphs.values())]
    sizes = {graph.sessions.sizes[0] for graph in beyond.graphs.values()}
    if not distinct(titles) or len(sizes) > 1:
        raise InputError(paths.BEYOND_PARAMS, "graphs", "expected titles that no other has, and the same size of all")
    for name, graph in beyond.graphs.items():
        if name in params.experiments:
            raise InputError(paths.BEYOND_PARAMS, f"graphs.{name}", "expected another name than those of experiments")
        try:
            settings_of(graph.source, f"graphs.{name}.source")
        except InputError as error:
            raise InputError(paths.BEYOND_PARAMS, *error.args[1:]) from error
        _check(params, graph.variant(name), f"graphs.{name}", "explore", {"graph": name})
    _check_hidden(beyond)


def _check_hidden(beyond: Beyond) -> None:
    for name, how in beyond.hidden.items():
        _check_names(how.initializers, INITIALIZERS.names(), f"hidden.{name}.initializers")
        if how.source == "graphs":
            _check_names([name], beyond.graphs, f"hidden.{name}")


def _check_names(listed: Iterable[str], there: Collection[str], key: str) -> None:
    unknown = [one for one in listed if one not in there]
    if unknown:
        expected = f"expected names among {', '.join(there)}, got {unknown[0]!r}{meant(unknown[0], there)}"
        raise InputError(paths.BEYOND_PARAMS, key, expected)


def _check(params: Params, variant: Variant, key: str, stage: str, arguments: Mapping[str, str]) -> None:
    _check_names(variant.initializers, dict.fromkeys([*params.initializers, *variant.options]), f"{key}.initializers")
    try:
        for initializer, options in variant.options.items():
            options_of(initializer, options, f"{key}.options.{initializer}")
        everything = read(paths.PARAMS)
        given = StageContext(declared(stage, arguments, everything), stage)
        changed = variants.changed(given, variant.changes, f"{key}.changes").values
        check({name: changed.get(name, value) for name, value in everything.items()}, Params, f"{key}.changes")
    except InputError as error:  # which takes all params for those of the first pipeline
        raise InputError(paths.BEYOND_PARAMS, *error.args[1:]) from error


if __name__ == "__main__":
    try:
        check_beyond(load())
    except InputError as error:
        sys.exit(str(error))
