"""A process that changes a home until it is killed, and what must be there afterwards.

``python -m tools.kills.home WAY FOLDER`` prints a number for each change that is acknowledged.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import count, islice, product
from pathlib import Path

import numpy as np

import isi
from isi.home import folder as folders
from isi.home.bundle import Bundle, Fact
from isi.home.home import Home
from isi.process import errors_in_one_line
from tests.environment import ENVIRONMENT
from tests.small_home import KNOWN, TRAINED, facts_of
from tools.kills.workspace import Fault, Lost, prepare_process

NEGATIVE = replace(KNOWN, entities=-KNOWN.entities)
#: Facts that ``KNOWN`` lacks between entities that it has.
OTHERS = [
    fact
    for fact in product(KNOWN.entity_names, KNOWN.relation_names, KNOWN.entity_names)
    if fact not in TRAINED
]


def fact_of(way: str, number: int) -> Fact:
    """Another fact for each number; the way ``tell`` inserts an entity by each third of them."""
    if way == "tell":
        return f"thing {number // 3}", "in", f"e{number % 30}"
    return OTHERS[number]


def tell(folder: Path) -> Iterator[int]:
    """Tell a home fact after fact."""
    with isi.open(folder) as home:
        for number in count(len(home.facts()) - len(TRAINED)):
            home.tell([fact_of("tell", number)], initializer="map")
            yield number


def train(folder: Path) -> Iterator[int]:
    """Tell a home fact after fact, and train it again after each."""
    with isi.open(folder) as home:
        for number in count(len(home.facts()) - len(TRAINED)):
            home.tell([fact_of("train", number)])
            home.train_again((KNOWN, NEGATIVE)[number % 2])
            yield number


def create(folder: Path) -> Iterator[int]:
    """Replace a home without changes by another one, again and again."""
    for number in count():
        folders.create((KNOWN, NEGATIVE)[number % 2], folder).close()
        yield number


WAYS = {"tell": tell, "train": train, "create": create}


def killed(folder: Path, way: str, cause: signal.Signals, chosen: random.Random) -> Fault:
    """Start a process, and send it a signal at a random moment."""
    with _started(way, folder) as process:
        printed = process.stdout or ()
        lines = list(islice(printed, chosen.randint(1, 20)))
        time.sleep(chosen.uniform(0, 0.02))
        process.send_signal(cause)
        lines += [line for line in printed if line.endswith("\n")]  # the last may be cut short
    return _checked(folder, Fault("a home", cause.name, way, process.returncode), lines)


def starved(folder: Path, way: str, enlarge: Callable[[], object]) -> Fault:
    """Start a process on a disk that it fills; then there is space again."""
    with _started(way, folder) as process:
        out, err = process.communicate()
    enlarge()
    fault = Fault("a home", "full", way, process.returncode)
    if len(err.splitlines()) != 1 or not process.returncode:
        return replace(fault, lost=f"no refusal in a line: {err[-300:]}")
    return _checked(folder, fault, out.splitlines())


def _started(way: str, folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tools.kills.home", way, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=ENVIRONMENT,
        text=True,
        preexec_fn=partial(prepare_process, os.getpid(), None),
    )


def _checked(folder: Path, fault: Fault, lines: Sequence[str]) -> Fault:
    """The fault, with what it has lost; ``lines``: what was acknowledged."""
    try:
        check(folder, fault.stage, int(lines[-1]) + 1 if lines else 0)
    except Lost as error:
        return replace(fault, lost=str(error))
    return fault


def check(folder: Path, way: str, acknowledged: int) -> None:
    """``Lost`` unless a home has the facts of all acknowledged changes, at most one more, and all
    that follows from them.
    """
    try:
        with isi.open(folder) as home:
            number = len(home.facts()) - len(TRAINED)
            facts = [fact_of(way, each) for each in range(number)]
            whole = home_of_facts(facts if way == "tell" else [], home.base)
            if way != "create" and number < acknowledged:
                raise Lost(f"of {acknowledged} facts, {number} are there")
            if facts_of(home).keys() != {*TRAINED, *facts}:
                raise Lost("other facts are there")
            if not any(np.array_equal(home.base.entities, each.entities) for each in BUNDLES):
                raise Lost("the vectors are of no embedding")
            if home.inserted.keys() != whole.inserted.keys():
                raise Lost("other entities are there")
            for name, row in whole.inserted.items():
                if not np.allclose(home.inserted[name].vector, row.vector, atol=1e-6):
                    raise Lost(f"another vector of {name}")
    except isi.InputError as error:
        raise Lost(f"the home cannot be opened: {error}") from error


BUNDLES = (KNOWN, NEGATIVE)


def home_of_facts(facts: list[Fact], bundle: Bundle) -> Home:
    """A home in memory that was given all facts at once, without being killed."""
    home = Home(replace(KNOWN, entities=bundle.entities))
    home.tell(facts, initializer="map")
    return home


def main() -> None:
    way, folder = sys.argv[1:]
    with errors_in_one_line("home"):
        for number in WAYS[way](Path(folder)):
            print(number, flush=True)


if __name__ == "__main__":
    main()
