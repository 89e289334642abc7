"""Check all params, for `make`: DVC reads only the keys that its stages name."""

import sys

from isi.process import errors_in_one_line
from stages.params import load, load_beyond


def check_params(runs: bool) -> None:
    """Check the params of all pipelines; ``runs``: also those of the second pipeline alone.

    Raises:
        InputError: names the file and the dotted key that is wrong.
    """
    load_beyond(load(), runs=runs)


if __name__ == "__main__":
    with errors_in_one_line("params"):
        check_params(runs="beyond" in sys.argv)
