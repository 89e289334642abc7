"""Record scenes of the live AI2-THOR simulator, for sources that are set to `from: simulator`.

Resumes where an earlier run stopped. The settings are those of the section `recorder` of
params.yaml, which no stage of a pipeline reads; arguments override them.
"""

import argparse
from contextlib import closing
from pathlib import Path

from tqdm import tqdm

from isi import config
from isi.process import Parser, errors_in_one_line
from isi.sources.recordings import Recorder
from isi.tables import paths


def record(settings: Recorder) -> None:
    """Record the scenes that the recording lacks.

    Raises:
        InputError: if the simulator does not return a scene, or if the recording cannot be read or
            written; scenes that were recorded before the error stay.
    """
    # here, since it imports the simulator's package
    from isi.recorder import Recording, Simulator, header

    with closing(Simulator(settings)) as simulator:
        recording = Recording(Path(settings.output), header(settings))
        missing = [layout for layout in settings.layouts if layout.name not in recording.names]
        for layout in tqdm(missing, unit="scene", disable=None):
            recording.append(layout, simulator.objects(layout))
    print(f"{len(recording.names):,} scenes in {recording.path}, {len(missing):,} of them new")


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
        record(config.check(settings, Recorder, "recorder"))


if __name__ == "__main__":
    main()
