"""How a mistake is made: a command is typed, or the library called."""

from __future__ import annotations

import contextlib
import io
import runpy
import shlex
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import isi
from isi.__main__ import main
from isi.errors import InputError
from isi.insertion.result import Inserted
from isi.params import load, load_beyond
from isi.process import one_line
from tests.mistakes import of_pykeen
from tests.mistakes.calls import Program, Typed
from tests.small_embedding import call, fit


@cache
def inserted() -> Inserted:
    return call()


#: What takes the arguments, by the name of what is called.
LIBRARY: dict[str, Callable[..., object]] = {
    "isi.insert": call,
    "isi.fit_new": lambda **given: fit(inserted(), **given),
    "Inserted.report": lambda **given: inserted().report(**given),
    "Inserted.interference": lambda **given: inserted().interference(**given),
    "isi.pykeen.insert": lambda **given: isi.pykeen.insert(**{**of_pykeen.sound(), **given}),
}


def line_of(program: Program, case: Typed) -> tuple[str, object, str]:
    """What a command says on the standard error, its status, and what it prints."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as ended:
        _run(program.module, shlex.split(case.typed))
    status = ended.value.code
    if isinstance(status, str):  # as Python ends a program that is left so
        return status, 1, out.getvalue()
    return err.getvalue().removesuffix("\n"), status, out.getvalue()


def _run(module: str, arguments: list[str]) -> None:
    """As ``python -m`` does, in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [module, *arguments])
        if module == "isi":
            main(arguments)
        elif module == "isi.params":  # pydantic resolves its types in the module of that name
            with one_line("params"):
                load_beyond(load())
            sys.exit(0)
        else:
            runpy.run_module(module, run_name="__main__")


def message_of(name: str, given: dict[str, Any]) -> str:
    """What the library says of arguments."""
    with pytest.raises(InputError) as refused:
        LIBRARY[name](**given)
    return str(refused.value)


def files() -> dict[Path, bytes]:
    """What lies in this folder."""
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
