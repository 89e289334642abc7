"""Run named checks of a subject, and say which one found what."""

import inspect
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import torch
from torch import Tensor

from isi.errors import InputError, at

T = TypeVar("T")
#: Yields a text for each problem that it finds; its docstring is a sentence on what should hold.
Check = Callable[[T], Iterator[str]]


def run_checks(name: str, checks: Sequence[Check[T]], subject: T) -> list[str]:
    """Run checks in turn, with one thread, as workers do, on which bits depend; their names.

    ``InputError`` names the first check that fails, what it expects, and the problem. Another error
    of the subject is raised as it is, with a note of the check.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for check in checks:
            _run(name, check, subject)
    finally:
        torch.set_num_threads(threads)
    return [check.__name__ for check in checks]


def _run(name: str, check: Check[T], subject: T) -> None:
    expected = (inspect.getdoc(check) or "").replace("\n", " ").rstrip(".")
    try:
        with at(name, f"check {check.__name__}"):
            for problem in check(subject):
                raise InputError("", "", f"expected: {expected}; but {problem}")
    except Exception as error:
        error.add_note(f"in the check {check.__name__} of {name}: {expected}")
        raise


def gap(label: str, values: Tensor, expected: Tensor) -> Iterator[str]:
    """A problem if numbers differ by more than rounding, or in shape."""
    if values.shape != expected.shape:
        yield f"{label} has the shape {tuple(values.shape)}, not {tuple(expected.shape)}"
    elif not torch.allclose(values, expected, rtol=1e-4, atol=1e-5):
        yield f"{label} differs by up to {(values - expected).abs().max().item():.2g}"


def changed_bits(label: str, values: Tensor, expected: Tensor) -> Iterator[str]:
    """A problem if any number differs in any bit."""
    if not torch.equal(values, expected):
        yield f"{label} differs"
