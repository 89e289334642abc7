"""Some hundreds of changed files in another process; equivalent files in other forms;
the largest files.
"""

import codecs
import gzip
from collections.abc import Callable, Iterator

import pytest

from tools.fuzz.campaign import read_changed, try_giants
from tools.fuzz.formats import FORMATS
from tools.fuzz.mutations import GZIP
from tools.fuzz.worker import Worker

INPUTS = 16
#: Titles of the largest files that are refused within a short time.
QUICK = [
    "a scene of a million objects",
    "a house of a million objects",
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
    assert worker.read(name, FORMATS[name].files).kind == "read"
    counts = read_changed(name, INPUTS, 1, worker)
    assert [problem for problem, _ in counts.faults] == []
    assert counts.inputs == INPUTS


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
    plain = worker.read(name, files)
    for file, content in files.items():
        if is_text(file, content):
            again = worker.read(name, files | {file: form(content)})
            assert (again.kind, again.problem, again.meaning) == ("read", "", plain.meaning), file


@pytest.mark.parametrize(
    ("name", "file"), [("recording", "r.jsonl.gz"), ("table, TSV", "log.tsv.gz")]
)
def test_a_mark_within_a_compressed_file_changes_nothing(
    worker: Worker, name: str, file: str
) -> None:
    files = FORMATS[name].files
    again = worker.read(name, {file: gzip.compress(marked(gzip.decompress(files[file])))})
    assert again.meaning == worker.read(name, files).meaning != ""


@pytest.mark.parametrize("name", QUICK)
def test_a_file_that_is_too_large_or_too_deep_is_refused(name: str) -> None:
    counts = try_giants([name])
    assert (counts.refused, counts.faults) == (1, [])


def test_each_fault_of_a_reader_is_noticed_and_the_next_file_is_read() -> None:
    expected = {
        "!endless in C": "more than 1 s",
        "!memory": "MemoryError",
        "!dies": "the process ended with status 3",
        "!writes into an output": "an output was touched",
        "!leaves a file": "files are left: ['.x.tmp']",
        "!is not printable": "not printable",
        "!is long": "500 characters",
        "!raises": "KeyError: 'head'",
    }
    with Worker(seconds=1) as worker:
        problems = {name: worker.read(name, {}).problem for name in expected}
        assert worker.read("words", FORMATS["words"].files).kind == "read"
    assert {name for name, problem in expected.items() if problem not in problems[name]} == set()
