"""Compute what the page's picture and explorer show, and list the registered initializers."""

import json
from functools import partial
from pathlib import Path

from isi.analyses.demonstration import (
    DEMONSTRATION,
    REGISTERED,
    Explored,
    demonstrated,
    registered,
)
from isi.tables.io import atomically, keep_only
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def demonstrate(context: StageContext) -> None:
    params, chosen, shown = context.params, context.params.explorer, dict[Path, str]()
    for experiment in chosen.experiments:
        store, fraction = Store(experiment), params.sessions.insert_fraction
        explored = Explored.read(store, params.model_of(), chosen.size, chosen.seed)
        kinds = store.entities()["kind"]
        content = demonstrated(explored, kinds, params.initializers, params.seed, fraction)
        path = DEMONSTRATION.path(experiment=experiment)
        shown[path] = json.dumps(content, ensure_ascii=False, allow_nan=False)
    folder = DEMONSTRATION.path(experiment="").parent
    folder.mkdir(parents=True, exist_ok=True)  # DVC expects it, even without experiments
    keep_only(folder, list(shown))
    listed = registered().to_csv(index=False, lineterminator="\n")
    for path, text in {**shown, REGISTERED.path(): listed}.items():
        atomically(path, partial(Path.write_bytes, data=text.encode()))


if __name__ == "__main__":
    demonstrate()
