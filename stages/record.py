"""Record scenes of the live AI2-THOR simulator, for sources that are set to `from: simulator`.

Resumes where an earlier run stopped. The settings are those of the section `recorder` of
params.yaml, which no stage of a pipeline reads; arguments override them.
"""

import argparse

from isi import config
from isi.process import Parser, errors_in_one_line
from isi.sources.recordings import Recorder
from isi.tables import paths


def main() -> None:
    parser = Parser(
        prog="python -m stages.record",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    several = "ithor, robothor, floor plans by name, or ranges such as FloorPlan201-230"
    parser.add_argument("--scenes", nargs="+", metavar="SCENE", help=several)
    parser.add_argument(
        "--platform", help="a build to download, such as CloudRendering, or the path of one"
    )
    parser.add_argument("--output", help="the recording, such as data/recordings/robothor.jsonl.gz")
    given = {key: value for key, value in vars(parser.parse_args()).items() if value is not None}
    with errors_in_one_line("record", "the same command goes on from here"):
        section = config.read(paths.PARAMS).get("recorder")
        settings = {**section, **given} if isinstance(section, dict) else section
        recorder = config.check(settings, Recorder, "recorder")
        from isi.recorder import record  # here, since it imports the simulator's package

        recording, missing = record(recorder)
        new = sum(layout.name in recording.names for layout in missing)
        print(f"{len(recording.names):,} scenes in {recording.path}, {new:,} of them new")


if __name__ == "__main__":
    main()
