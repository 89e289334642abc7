"""Run ``dvc repro``, saying which stage of how many runs, and how long the rest may take."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from pathlib import Path

from dvc.repo import Repo

#: Seconds that each stage took when it last ran here; before that, on the machine of the documentation.
HERE = Path(".dvc/tmp/stage_seconds.json")
SHIPPED = Path(__file__).parent.parent / "docs" / "benchmarks" / "stage_seconds.json"
BEGINS = re.compile(r"^Running stage '(?P<stage>[^']+)'|^Stage '(?P<same>[^']+)' (didn't change|is cached)")


class Progress:
    """Stages that are still to come, and how long each takes."""

    def __init__(self, stages: list[str], seconds: dict[str, float]) -> None:
        self.number, self.waiting, self.seconds = len(stages), set(stages), seconds
        self.start, self.running, self.since = time.monotonic(), "", 0.0

    def begin(self, stage: str, runs: bool) -> str | None:
        """Note that a stage begins, or is skipped; where that leaves us, if it runs."""
        self.end()
        self.waiting.discard(stage)
        if not runs:
            return None
        self.running, self.since = stage, time.monotonic()
        gone = f"{(self.since - self.start) / 60:.0f} min gone"
        left = sum(self.seconds.get(name, 0) for name in [stage, *self.waiting]) / 60
        about = f"; at most about {left:.0f} min left" if left >= 1 else ""
        return f"[{self.number - len(self.waiting)} of {self.number}; {gone}{about}]"

    def end(self) -> None:
        """Note how long the stage that ran took."""
        if self.running:
            self.seconds[self.running] = round(time.monotonic() - self.since, 1)
        self.running = ""


def main(arguments: list[str]) -> int:
    """Run DVC, passing its output on; its exit status."""
    progress = Progress([stage.addressing for stage in Repo().index.stages], {**_read(SHIPPED), **_read(HERE)})
    command = [sys.executable, "-m", "dvc", "repro", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, bufsize=1) as dvc:
        try:
            for line in dvc.stdout or ():
                found = BEGINS.match(line)
                said = progress.begin(found["stage"] or found["same"], bool(found["stage"])) if found else None
                print(*filter(None, [said, line]), sep="\n", end="", flush=True)
        except KeyboardInterrupt:
            pass  # DVC was interrupted, too, and says so
    if not dvc.returncode:
        progress.end()
    HERE.parent.mkdir(parents=True, exist_ok=True)
    HERE.write_text(json.dumps(progress.seconds, indent=1, sort_keys=True), encoding="utf-8")
    return dvc.returncode


def _read(path: Path) -> dict[str, float]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
