"""The README and docs/: tables and numbers are current, links lead to existing targets,
and the code runs.
"""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from isi.__main__ import main
from tests import committed
from tools import docs

PAGES = [*docs.pages(), *(docs.ROOT / name for name in ("CONTRIBUTING.md", "CHANGELOG.md"))]
LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@each_page
def test_what_pages_show_is_what_was_made(page: Path, request: pytest.FixtureRequest) -> None:
    """Pages show the report of the last run or, if `make readme` has not run since,
    that of the last commit.
    """
    text = page.read_text(encoding="utf-8")
    if docs.filled(text) != text:
        assert docs.filled(text, request.getfixturevalue("as_committed")) == text, "make readme"


@pytest.fixture(scope="module")
def as_committed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return committed.with_report(tmp_path_factory.mktemp("committed"))


@each_page
def test_marks_leave_the_cells_of_tables_whole(page: Path) -> None:
    rows = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    marks = [mark for row in rows for mark in re.findall(r"<!-- value: (.*?) -->", row)]
    assert page.name == "README.md" or not [mark for mark in marks if "|" in mark]


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    for path, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        if path.startswith("https://"):
            continue
        target = page.parent / path if path else page
        assert target.exists(), path
        if anchor:
            assert anchor in {
                slug(heading) for heading in HEADING.findall(target.read_text(encoding="utf-8"))
            }, anchor


def test_the_first_page_is_short() -> None:
    assert len((docs.ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 90


@pytest.mark.parametrize("page", docs.pages()[1:], ids=lambda page: page.name)
def test_a_page_opens_with_the_question_that_it_answers(page: Path) -> None:
    title, _, question, blank, *_ = page.read_text(encoding="utf-8").splitlines()
    assert title.startswith("# ")
    assert re.fullmatch(r"\*[A-Z].*\?\*", question)
    assert not blank


def slug(heading: str) -> str:
    """The anchor of a heading, as forges build it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


@each_page
def test_pages_install_from_the_folder_since_no_index_has_the_package(page: Path) -> None:
    assert not re.search(r"pip install ['\"]?isi-kge", page.read_text(encoding="utf-8"))


def printed(arguments: list[str], folder: Path) -> str:
    """What ``isi`` prints, in this process, which saves the imports."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.chdir(folder):
        main(arguments)
    return out.getvalue()


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if docs.needs(page.read_text("utf-8")) is not None],
    ids=lambda page: page.name,
)
def test_pages_show_what_commands_print(page: Path, tmp_path: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for need in docs.needs(text) or []:
        if "/" not in need:
            pytest.importorskip(need)
        elif not (docs.ROOT / need).exists():
            pytest.skip(f"no {need}")
    docs.prepare(tmp_path)
    made = docs.with_output(text, tmp_path, printed)
    assert docs.alike(made, text), f"python -m tools.docs {page.relative_to(docs.ROOT)}"


def test_places_are_filled_from_markdown_and_from_csv(tmp_path: Path) -> None:
    (tmp_path / "speed.csv").write_text(
        'what,ms,by\n"one, two","1,200",a\nthree,7.5 s,\n', encoding="utf-8"
    )
    (tmp_path / "mrr.md").write_text(
        "| model | MRR |\n| --- | ---: |\n| ES | 72.1 [71, 73] |\n", encoding="utf-8"
    )
    table = (
        "| what | ms | by |\n| --- | ---: | --- |\n| one, two | 1,200 | a |\n| three | 7.5 s |  |\n"
    )
    page = (
        "<!-- table: speed -->{}<!-- end --> <!-- value: speed::one, two::ms -->{}<!-- end --> {}"
    )
    number = "<!-- value: mrr | ES | MRR -->72.1<!-- end -->"
    stale = page.format("", "1", number.replace("72.1", "70"))
    assert docs.filled(stale, tmp_path) == page.format("\n" + table, "1,200", number)
    with pytest.raises(LookupError, match="three::hours"):
        docs.filled("<!-- value: speed::three::hours --><!-- end -->", tmp_path)


def test_named_columns_of_a_table_are_shown(tmp_path: Path) -> None:
    (tmp_path / "mrr.md").write_text(
        "| model | IU | ES |\n| --- | ---: | ---: |\n| a | 1.0 | – |\n| b | 2.0 | 72.1 |\n", "utf-8"
    )
    page = "<!-- table: mrr::model::ES -->{}<!-- end -->"
    expected = "\n| model | ES |\n| --- | ---: |\n| a | – |\n| b | 72.1 |\n"
    assert docs.filled(page.format("stale"), tmp_path) == page.format(expected)
    with pytest.raises(LookupError, match="no RS"):
        docs.filled("<!-- table: mrr::RS --><!-- end -->", tmp_path)


SHOWN = """# Page

<!-- console: data/raw -->
<!-- file: mine/entities.txt -->
```
kettle
bed
```

```console
$ isi import mine --model distmult --out imported
$ isi ask kettle near --home imported
$ sqlite3 imported/home.sqlite "select name, status, kind from entity where row = 0"
{}```

No output, so none is made:

```console
$ isi ask kettle near --home imported
```
"""


def test_output_is_made_from_the_files_of_the_page(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "relations.txt").write_text("near\n", encoding="utf-8")
    vectors = {"entities": np.array([[3.0, 4.0], [4.0, 3.0]]), "relations": np.ones((1, 2))}
    np.savez(tmp_path / "mine" / "tables.npz", **vectors)
    page = SHOWN.format("stale\n")
    assert docs.needs(page) == ["data/raw"]
    made = docs.with_output(page, tmp_path, printed)
    assert made == SHOWN.format("kettle|trained|\n")
    assert not docs.alike(made, page)
    assert docs.needs("```console\n$ isi ask\n```\n") is None


def test_lines_that_are_left_out_of_output_stay_out() -> None:
    printed = "".join(f"{number}\n" for number in range(9))
    assert docs.shortened(printed, "a\nb\n...\nc\n") == "0\n1\n...\n8\n"
    assert docs.shortened(printed, "a\n...\n") == "0\n...\n"
    assert docs.shortened(printed, "a\nb\n") == printed
    assert docs.shortened("0\n1\n", "a\n...\nb\nc\n") == "0\n1\n"


@pytest.mark.parametrize(
    ("other", "same"),
    [
        ("a  0.512 -3e-05\n", True),
        ("a 0.521 0\n", True),
        ("a 0.53 0\n", False),
        ("b 0.512 0\n", False),
        ("a 0.512\n", False),
        ("a 0.512 0 1\n", False),
        ("a nan 0\n", False),
    ],
)
def test_only_the_last_digits_of_numbers_may_differ(other: str, same: bool) -> None:
    assert docs.alike("a 0.512 0\n", other) is same


def test_a_run_is_recorded_with_its_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(docs, "BENCHMARKS", tmp_path)
    before = {"date": "1 May 2026", "isi": "0.1.0", "commit": "12345678", "machine": "a machine"}
    rows = [{"table": name, **before} for name in ("fuzz", "speed")]
    pd.DataFrame(rows).to_csv(tmp_path / "runs.csv", index=False)
    run = docs.this_run()
    docs.record(run, ["fuzz"])
    after = pd.read_csv(tmp_path / "runs.csv", dtype=str).set_index("table")
    assert after.loc["fuzz"].to_dict() == run
    assert after.loc["speed"].to_dict() == before
    words = (tmp_path / "machine.md").read_text(encoding="utf-8")
    assert "- speed: one run on 1 May 2026, isi 0.1.0, commit 12345678; a machine.\n" in words


def test_the_record_of_runs_names_tables_that_there_are_and_is_in_words_too() -> None:
    runs = pd.read_csv(docs.BENCHMARKS / "runs.csv", dtype=str)
    assert [name for name in runs["table"] if not (docs.BENCHMARKS / f"{name}.csv").exists()] == []
    assert runs["table"].is_unique
    words = (docs.BENCHMARKS / "machine.md").read_text(encoding="utf-8")
    assert words == docs.runs_in_words(runs)


def test_a_processor_has_the_name_of_its_model(tmp_path: Path) -> None:
    info = tmp_path / "cpuinfo"
    info.write_text(
        "processor\t: 0\ncpu family\t: 25\nmodel name\t: AMD EPYC 7B13\nflags\t: fpu\n", "utf-8"
    )
    assert docs.processor(info) == "AMD EPYC 7B13 (family 25)"
    assert docs.processor(tmp_path / "none")
