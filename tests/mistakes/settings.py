"""Mistakes in params (``test_params`` has more),
of the recorder and of the tools around the pipeline.
"""

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from isi.sources.recordings import FORMAT
from isi.tables import paths
from tests.mistakes.calls import Typed, params

#: The bytes of a program with known SHA-256.
PLAYER = b"#!/bin/sh\n"


def beyond(**sections: Any) -> Callable[[], object]:
    """A function that writes params of the second pipeline:
    the first entry of each section, with changed values.
    """

    def write() -> None:
        values = yaml.load(paths.BEYOND_PARAMS.read_text(encoding="utf-8"), yaml.CSafeLoader)
        kept = {
            name: dict(list(values[name].items())[:1]) for name in ("variants", "graphs", "hidden")
        }
        changed = {name: section(kept[name]) for name, section in sections.items()}
        paths.BEYOND_PARAMS.write_text(
            yaml.safe_dump({**values, **kept, **changed}), encoding="utf-8"
        )

    return write


def first(**changes: Any) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A function that changes values in each entry of a section."""
    return lambda section: {name: {**value, **changes} for name, value in section.items()}


def player(recording: bytes | None = None, **changes: Any) -> Callable[[], object]:
    """A function that writes a player (never started), a recording and params of the recorder."""

    def write() -> None:
        Path("player").write_bytes(PLAYER)
        Path("player").chmod(0o755)
        if recording is not None:
            Path("r").write_bytes(recording)
        given = {"platform": "player", "output": "r", **changes}
        params({f"recorder.{key}": value for key, value in given.items()})()

    return write


def lines(*records: object) -> bytes:
    return b"".join(gzip.compress(f"{json.dumps(one)}\n".encode()) for one in records)


PARAMS_CASES = [
    Typed(
        "a variant of an unknown initializer",
        "beyond",
        "beyond/params.yaml|variants.baselines.initializers",
        before=beyond(variants=first(initializers=["xaver"])),
    ),
    Typed(
        "a variant that changes no section",
        "beyond",
        "beyond/params.yaml|variants.baselines.changes",
        before=beyond(variants=first(changes={"sesions.valid": 0.2})),
    ),
    Typed(
        "a variant that changes what it may not",
        "beyond",
        "beyond/params.yaml|variants.baselines.changes.training.learning_rate",
        before=beyond(variants=first(changes={"training.learning_rate": -1.0})),
    ),
    Typed(
        "two graphs of one title",
        "beyond",
        "beyond/params.yaml|graphs",
        before=beyond(graphs=lambda section: {**section, "again": next(iter(section.values()))}),
    ),
    Typed(
        "a graph by the name of an experiment",
        "beyond",
        "beyond/params.yaml|graphs.ai2thor",
        before=beyond(graphs=lambda section: {"ai2thor": next(iter(section.values()))}),
    ),
    Typed(
        "a graph of an unknown reader",
        "beyond",
        "beyond/params.yaml|graphs.behavior.source.reader",
        before=beyond(graphs=first(source={"reader": "whales"})),
    ),
    Typed(
        "entities hidden in a graph that there is not",
        "beyond",
        "beyond/params.yaml|hidden.place.graph",
        before=beyond(
            hidden=lambda section: {
                "place": {**next(iter(section.values())), "source": "graphs", "graph": "nowhere"}
            }
        ),
    ),
]

RECORD_CASES = [
    Typed("no layouts", "", "params.yaml|recorder.spawns", before=player(spawns=[])),
    Typed(
        "a layout that is no seed", "", "params.yaml|recorder.spawns.0", before=player(spawns=["3"])
    ),
    Typed("an empty file where the recording is to be", "", "r", before=player(b"")),
    Typed("a file that is none", "", "r|byte 0", before=player(b"a photograph")),
    Typed(
        "a recording of another build",
        "",
        "r|line 1",
        before=player(
            lines({**FORMAT, "simulator": "ai2thor", "build": "thor-1", "package": "5.0.0"})
        ),
    ),
    Typed(
        "a line that holds no scene",
        "",
        "r|line 2",
        before=player(
            lines(
                {
                    **FORMAT,
                    "simulator": "ai2thor",
                    "build": "player a8076d3d28d21e02",
                    "package": "5.0.0",
                },
                3,
            )
        ),
    ),
]
