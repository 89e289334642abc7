"""Check all params, for `make`: DVC reads only the keys that its stages name."""

import sys

from isi.benchmark.study import study_of
from isi.errors import at
from isi.params import check_names, load, load_beyond
from isi.process import errors_in_one_line
from isi.tables import paths


def check_params(runs: bool) -> None:
    """Check the params of all pipelines; ``runs``: also those of the second pipeline alone.

    Raises:
        InputError: names the file and the dotted key that is wrong.
    """
    beyond = load_beyond(load(), runs=runs)
    for name in beyond.hidden:
        study = study_of(beyond.hidden, name)
        if study.source == "graphs":
            with at(paths.BEYOND_PARAMS):
                check_names([study.graph], beyond.graphs, f"hidden.{name}.graph")


if __name__ == "__main__":
    with errors_in_one_line("params"):
        check_params(runs="beyond" in sys.argv)
