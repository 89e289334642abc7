"""Some hundreds of changed files in a process of their own; files that differ in their form alone; the largest ones."""

from __future__ import annotations

import codecs
import gzip
import json
from collections.abc import Callable, Iterator

import pytest

from tests.fuzz.__main__ import table
from tests.fuzz.campaign import Counts, of_giants, tried
from tests.fuzz.formats import FORMATS
from tests.fuzz.giants import GIANTS
from tests.fuzz.mutations import GZIP
from tests.fuzz.worker import Outcome, Worker

INPUTS = 16
#: Of the largest files, those that are refused at once.
QUICK = [
    "a scene of a million objects", "a house of a million objects", "lists in lists in a scene, a million deep",
    "mappings in mappings, a million deep", "lists in lists in Turtle", "a header that promises a billion vectors",
]  # fmt: skip


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with Worker() as found:
        yield found


@pytest.mark.parametrize("name", FORMATS)
def test_whatever_a_file_holds_it_is_read_or_refused_in_one_line(worker: Worker, name: str) -> None:
    assert worker.read(name, FORMATS[name].files).kind == "read"
    counts = tried(name, INPUTS, 1, worker)
    assert [said for said, _ in counts.faults] == []
    assert counts.inputs == INPUTS


def marked(content: bytes) -> bytes:
    """As Excel writes it."""
    return codecs.BOM_UTF8 + content


def with_returns(content: bytes) -> bytes:
    return content.replace(b"\n", b"\r\n")


def is_text(name: str, content: bytes) -> bool:
    return not (name.endswith((".bin", ".parquet", ".safetensors")) or content.startswith(GZIP))


TEXT = [name for name, one in FORMATS.items() if any(is_text(*file) for file in one.files.items())]


@pytest.mark.parametrize("form", [marked, with_returns])
@pytest.mark.parametrize(
    "name", [name for name, one in FORMATS.items() if any(is_text(*file) for file in one.files.items())]
)
def test_a_byte_order_mark_or_another_line_end_changes_nothing(
    worker: Worker, name: str, form: Callable[[bytes], bytes]
) -> None:
    own = FORMATS[name].files
    plain = worker.read(name, own)
    for file, content in own.items():
        if is_text(file, content):
            again = worker.read(name, own | {file: form(content)})
            assert (again.kind, again.said, again.meaning) == ("read", "", plain.meaning), file


@pytest.mark.parametrize(("name", "file"), [("recording", "r.jsonl.gz"), ("table, TSV", "log.tsv.gz")])
def test_a_mark_within_a_compressed_file_changes_nothing(worker: Worker, name: str, file: str) -> None:
    own = FORMATS[name].files
    again = worker.read(name, {file: gzip.compress(marked(gzip.decompress(own[file])))})
    assert again.meaning == worker.read(name, own).meaning != ""


@pytest.mark.parametrize("name", QUICK)
def test_a_file_that_is_too_large_or_too_deep_is_refused(worker: Worker, name: str) -> None:
    counts = of_giants(worker, [name])
    assert (counts.refused, counts.faults) == (1, [])


def test_giants_are_of_formats_that_there_are() -> None:
    assert {form for form, _ in GIANTS.values()} <= set(FORMATS)


def test_what_hangs_or_takes_too_much_memory_or_dies_is_a_fault() -> None:
    with Worker(seconds=1) as worker:
        assert worker.read("!endless in C", {}).said == "more than 1 s"
        assert "MemoryError" in worker.read("!memory", {}).said
        assert worker.read("!dies", {}).said == "the process ended with status 3"
        assert worker.read("words", FORMATS["words"].files).kind == "read"


def test_what_touches_an_output_or_says_too_much_is_a_fault(worker: Worker) -> None:
    said = [worker.read(name, {}).said for name in ("!touches", "!leaves", "!lines", "!says much", "!traceback")]
    assert said[0].startswith("an output was touched")
    assert said[1] == "files are left: ['.x.tmp']"
    assert said[2].startswith("not printable")
    assert said[3].startswith("500 characters")
    assert said[4].endswith("KeyError: 'head'\n")


def test_the_table_counts_what_became_of_each_format_and_of_all() -> None:
    one, other = Counts("scene"), Counts("words")
    for kind, seconds in (("read", 0.25), ("refused", 1.5), ("fault", 0.0)):
        one.add({}, Outcome(kind, "said", "", seconds, 300))
    other.add({}, Outcome("read", "", "", 0.1, 2_000))
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table([one, other]).splitlines()]
    assert rows[2] == ["scene", "3", "1", "1", "1", "1.5", "300"]
    assert rows[-1] == ["all", "4", "2", "1", "1", "1.5", "2,000"]


def test_files_are_json_where_their_name_says_so() -> None:
    for one in FORMATS.values():
        for name, content in one.files.items():
            if name.endswith(".json"):
                json.loads(content)
