"""Some hundreds of changed files in another process; equivalent files in other forms;
the largest files.
"""

import codecs
import gzip
import os
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from isi.errors import InputError
from tools.fuzz.campaign import read_changed, read_giant
from tools.fuzz.changes import GZIP
from tools.fuzz.formats import FORMATS, Format
from tools.fuzz.worker import Worker

INPUTS = 16
#: Titles of the largest files that are refused within a short time.
QUICK = [
    "a scene of a million objects",
    "lists in lists in a scene, a million deep",
    "mappings in mappings, a million deep",
    "lists in lists in Turtle",
    "a header that promises a billion vectors",
]


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with Worker() as started:
        yield started


@pytest.mark.parametrize("name", FORMATS)
def test_whatever_a_file_holds_it_is_read_or_refused_in_one_line(worker: Worker, name: str) -> None:
    assert worker.read(FORMATS[name], FORMATS[name].files).kind == "read"
    outcomes = read_changed(name, INPUTS, 1, worker)
    assert [outcome.problem for outcome in outcomes if outcome.kind == "fault"] == []
    assert len(outcomes) == INPUTS


def marked(content: bytes) -> bytes:
    """The content with a byte order mark, as Excel writes it."""
    return codecs.BOM_UTF8 + content


def with_returns(content: bytes) -> bytes:
    return content.replace(b"\n", b"\r\n")


def is_text(name: str, content: bytes) -> bool:
    return not (name.endswith((".bin", ".parquet", ".safetensors")) or content.startswith(GZIP))


@pytest.mark.parametrize("form", [marked, with_returns])
@pytest.mark.parametrize(
    "name",
    [name for name, one in FORMATS.items() if any(is_text(*file) for file in one.files.items())],
)
def test_a_byte_order_mark_or_another_line_end_changes_nothing(
    worker: Worker, name: str, form: Callable[[bytes], bytes]
) -> None:
    files = FORMATS[name].files
    plain = worker.read(FORMATS[name], files)
    for file, content in files.items():
        if is_text(file, content):
            again = worker.read(FORMATS[name], files | {file: form(content)})
            assert (again.kind, again.problem, again.meaning) == ("read", "", plain.meaning), file


@pytest.mark.parametrize(
    ("name", "file"), [("recording", "r.jsonl.gz"), ("table, TSV", "log.tsv.gz")]
)
def test_a_mark_within_a_compressed_file_changes_nothing(
    worker: Worker, name: str, file: str
) -> None:
    files = FORMATS[name].files
    again = worker.read(FORMATS[name], {file: gzip.compress(marked(gzip.decompress(files[file])))})
    assert again.meaning == worker.read(FORMATS[name], files).meaning != ""


@pytest.mark.parametrize("title", QUICK)
def test_a_file_that_is_too_large_or_too_deep_is_refused(worker: Worker, title: str) -> None:
    assert read_giant(title, worker).kind == "refused"


# Readers with faults


class Verbatim(InputError):
    """An ``InputError`` whose message is neither shortened nor escaped."""

    def __str__(self) -> str:
        return ": ".join(part for part in self.args if part)


OUT = Path("out/table.parquet")


def is_endless_in_c() -> str:
    return str(re.match(r"(a+)+$", "a" * 60 + "b"))


def takes_memory() -> str:
    return str(len(bytearray(3 * 2**30)))


def leaves_half(path: Path) -> str:
    path.write_bytes(b"half")
    raise InputError("file", "", "is broken")


def refuses(message: str) -> str:
    raise Verbatim("file", "", message)


@pytest.fixture(scope="module")
def hasty() -> Iterator[Worker]:
    with Worker(seconds=1) as started:
        yield started


@pytest.mark.parametrize(
    ("read", "problem"),
    [
        (is_endless_in_c, "the process died: a crash, or more than 1 s"),
        (partial(os._exit, 3), "the process died"),
        (takes_memory, "MemoryError"),
        (partial(leaves_half, OUT), "an output was touched"),
        (partial(leaves_half, Path(".x.tmp")), "files are left: ['.x.tmp']"),
        (partial(refuses, "is \x1b[2J"), "not printable"),
        (partial(refuses, "x" * 494), "500 characters"),
        (partial({"": ""}.__getitem__, "head"), "KeyError: 'head'"),
    ],
)
def test_a_fault_of_a_reader_is_noticed_and_the_next_file_is_read(
    hasty: Worker, read: Callable[[], str], problem: str
) -> None:
    assert problem in hasty.read(Format({}, read, (OUT,)), {}).problem
    assert hasty.read(FORMATS["words"], FORMATS["words"].files).kind == "read"
