"""The command ``isi`` on entities: its output and files, its help, and its exit status."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from isi.live.folder import read

from isi.__main__ import main
from isi.cli import lines
from isi.tables import paths
from tests.small_bundle import NAMES, files, small, word_file, worded, written

ROOT = Path(__file__).parent.parent
STOVE = ["insert", "stove", "--fact", "atLocation", "kitchen", "--fact", "hasAffordance", "turn on"]
HOB = ["insert", "hob", "--fact", "atLocation", "kitchen"]
COMMANDS = (
    "insert",
    "observe",
    "move",
    "remove",
    "undo",
    "compact",
    "history",
    "ask",
    "nearest",
    "explain",
    "interference",
)
TO_HOB = ["observe", "--fact", "hob", "hasAffordance", "turn on"]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the small bundle as ``home``,
    whose words are of a file that has none of new names.
    """
    monkeypatch.chdir(tmp_path)
    return written(tmp_path / "home", worded(tmp_path))


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    main([*arguments, "--embedding", "home"] if "--embedding" not in arguments else list(arguments))
    out, err = capsys.readouterr()
    assert err == ""
    return out


def parsed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(printed(capsys, *arguments, "--json"))
    return result


def best(
    capsys: pytest.CaptureFixture[str], *question: str, embedding: str = "home"
) -> list[tuple[str, bool]]:
    """The answers to a query, and whether they are given facts."""
    result = parsed(capsys, "ask", *question, "--embedding", embedding)
    return [(answer["entity"], answer["given"]) for answer in result["answers"]]


# Changes


def test_facts_of_training_are_retracted_and_moved(capsys: pytest.CaptureFixture[str]) -> None:
    fact = ["kettle", "atLocation", "kitchen"]
    effect = parsed(capsys, "remove", "--fact", *fact)
    assert effect["lost"] == [fact]
    answers = parsed(capsys, "ask", *fact[:2])["answers"]
    assert "kitchen" not in [answer["entity"] for answer in answers]
    assert "facts added: 1" in printed(capsys, "undo")
    assert parsed(capsys, "ask", *fact[:2])["answers"][0]["known"]
    moved = parsed(capsys, "move", *fact[:2], "bedroom", "--source", "camera")
    assert (moved["lost"], moved["facts"]) == ([fact], 1)
    assert best(capsys, "kettle", "atLocation")[0] == ("bedroom", True)
    related = parsed(capsys, "ask", "kettle", "--tail", "kitchen")["answers"]
    assert "atLocation" not in [answer["entity"] for answer in related]
    with pytest.raises(SystemExit, match="holds"):
        main(
            [
                "move",
                "kettle",
                "atLocation",
                "bed",
                "--instead-of",
                "kitchen",
                "--embedding",
                "home",
            ]
        )
    assert "nothing has changed" in printed(capsys, "move", *fact[:2], "bedroom")
    last = parsed(capsys, "history")["changes"][-1]
    assert (last["change"], last["source"], last["replaced"]) == ("move", "camera", [fact])
    assert last["time"]


def test_what_is_known_is_observed_and_what_is_not_is_inserted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit, match="hob"):
        main([*TO_HOB, "--embedding", "home"])
    assert parsed(capsys, *TO_HOB, "--fact", "kettle", "atLocation", "bedroom", "--new")[
        "inserted"
    ] == ["hob"]
    with pytest.raises(SystemExit, match="known"):
        main([*HOB, "--embedding", "home"])
    effect = parsed(capsys, *HOB, "--upsert")
    assert (effect["inserted"], effect["updated"], effect["facts"]) == ([], ["hob"], 1)
    assert effect["notes"]
    assert (
        parsed(capsys, "insert", "kettle", "--fact", "atLocation", "bedroom", "--upsert")["known"]
        == 1
    )
    assert parsed(capsys, *STOVE, "--upsert")["entity"] == "stove"


@pytest.mark.parametrize(
    ("fact", "in_two_parts"),
    [
        (["hob", "atLocation", "kitchen"], ["--fact", "atLocation", "kitchen"]),
        (["kettle", "atLocation", "hob"], ["--inverse-fact", "kettle", "atLocation"]),
    ],
)
def test_a_fact_about_a_new_entity_may_have_all_three_parts(
    capsys: pytest.CaptureFixture[str], fact: list[str], in_two_parts: list[str]
) -> None:
    other = ["--fact", "hasAffordance", "turn on", "--dry-run"]
    expected = parsed(capsys, "insert", "hob", *in_two_parts, *other)
    for command in (
        ["insert", "hob", "--fact", *fact],
        ["insert", "--fact", *fact, "hob"],
        ["insert", "--embedding", "home", "hob", "--fact", *fact],
    ):
        assert parsed(capsys, *command, *other) == expected
    assert fact in expected["facts"]


def test_a_name_may_stand_behind_its_fact_and_one_of_several_words_needs_quotes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    report = parsed(capsys, "insert", "--dry-run", "--fact", "atLocation", "kitchen", "hob")
    assert report["facts"] == [["hob", "atLocation", "kitchen"]]
    with pytest.raises(SystemExit, match="quotes"):
        main(["insert", "hob", "--fact", "atLocation", "dining", "room", "--embedding", "home"])


def test_a_journal_is_compacted(capsys: pytest.CaptureFixture[str]) -> None:
    printed(capsys, *HOB)
    printed(capsys, *TO_HOB)
    printed(capsys, "undo")
    printed(capsys, "remove", "--fact", "kettle", "atLocation", "kitchen")
    before = parsed(capsys, "ask", "hob", "atLocation")
    assert "2" in printed(capsys, "compact")
    assert [change["change"] for change in parsed(capsys, "history")["changes"]] == [
        "insert",
        "remove",
    ]
    assert parsed(capsys, "ask", "hob", "atLocation") == before
    with pytest.raises(SystemExit, match="pipeline"):
        main(["compact", "--embedding", str(written(paths.final_model("mine"), small()))])


def test_queries_of_a_file_are_answered_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    table = "head,relation,tail\nkettle,atLocation,?\n?,hasAffordance,turn on\nkettle,,kitchen\n"
    Path("queries.csv").write_text(table, encoding="utf-8")
    results = parsed(capsys, "ask", "--from", "queries.csv")["results"]
    single = [
        parsed(capsys, "ask", "kettle", "atLocation"),
        parsed(capsys, "ask", "--relation", "hasAffordance", "--tail", "turn on"),
        parsed(capsys, "ask", "kettle", "--tail", "kitchen"),
    ]
    assert results == single
    assert printed(capsys, "ask", "--from", "queries.csv").count("?") == 3
    Path("queries.csv").write_text(table + "nobody,atLocation,?\n", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"queries\.csv: line 5.*nobody"):
        main(["ask", "--from", "queries.csv", "--embedding", "home"])
    for both in (["ask"], ["ask", "kettle", "atLocation", "--from", "queries.csv"]):
        with pytest.raises(SystemExit, match="--from"):
            main([*both, "--embedding", "home"])


def test_an_insertion_is_reported_as_json_and_in_sentences(
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = parsed(capsys, *STOVE, "--top", "1", "--dry-run")
    assert result["facts"] == [
        ["stove", "atLocation", "kitchen"],
        ["stove", "hasAffordance", "turn on"],
    ]
    assert (result["entity"], result["id"], result["kind"], result["initializer"]) == (
        "stove",
        6,
        "object",
        "map",
    )
    assert [(query["query"], query["answers"][0]["entity"]) for query in result["answers"]] == [
        (["stove", "atLocation", "?"], "kitchen"),
        (["stove", "hasAffordance", "?"], "turn on"),
    ]
    answer = result["answers"][0]["answers"][0]  # so few entities do not calibrate its probability
    assert {
        "known": True,
        "given": True,
        "inserted": False,
        "probability": None,
    }.items() <= answer.items()
    assert (len(result["nearest"]), result["interference"]["queries"]) == (1, 8)
    assert result["interference"] == result["interference_of_all"]
    text = printed(capsys, *STOVE, "--dry-run").splitlines()
    assert len(text) <= 15
    assert all(word in text[0] for word in ("stove", "object", "kettle"))
    assert any(
        re.fullmatch(r" +stove atLocation \?: kitchen \(given\), bedroom .*", line) for line in text
    )
    assert len(printed(capsys, *STOVE, "--dry-run", "--verbose").splitlines()) > len(text)


def test_the_answers_that_an_insertion_pushes_down_are_in_its_report(
    capsys: pytest.CaptureFixture[str],
) -> None:
    is_above = set[bool]()
    for seed in range(4):  # random vectors, some of which rank above known answers
        given = [*STOVE, "--dry-run", "--initializer", "xavier", "--seed", str(seed)]
        alone = parsed(capsys, *given)["interference"]
        share = f"{alone['above'][0]:.1%} of {alone['queries']} queries"
        assert (share in printed(capsys, *given)) == (alone["above"][0] > 0)
        verbose = printed(capsys, *given, "--verbose").splitlines()
        for change in alone["changes"]:
            ranks = f"from rank {change['rank_old']:g} to {change['rank_cur']:g}"
            query = f"  {' '.join(change['query'])}: {change['answer']} "
            assert any(line.startswith(query) and line.endswith(ranks) for line in verbose)
        is_above.add(bool(alone["changes"]))
    assert is_above == {False, True}


def test_a_change_goes_to_the_folder_or_to_a_copy_or_nowhere(
    capsys: pytest.CaptureFixture[str], home: Path
) -> None:
    before = files(home)
    for command in (STOVE, ["observe", "--fact", "kettle", "atLocation", "bedroom"]):
        assert "nothing is written" in printed(capsys, *command, "--dry-run")
        printed(capsys, *command, "--dry-run", "--out", "home")
        assert files(home) == before
    assert "written: copy" in printed(capsys, *STOVE, "--definition", "to cook on", "--out", "copy")
    assert files(home) == before
    assert read(Path("copy")).insertions()["stove"].definition == "to cook on"
    for out in ([], ["--out", "home"]):
        printed(capsys, *(HOB if out else STOVE), *out)
        after = files(home)
        journal = after.pop("journal.jsonl")
        assert after.pop("inserted.safetensors")
        assert after == before
        assert journal.count(b'"insert"') == 1 + bool(out)
    for embedding in ("home", "copy"):
        assert best(capsys, "stove", "hasAffordance", embedding=embedding)[0] == ("turn on", True)


def test_the_folder_of_the_pipeline_is_not_changed(capsys: pytest.CaptureFixture[str]) -> None:
    folder = written(paths.final_model("mine"), small())
    before = files(folder)
    for out in ([], ["--out", "copy"]):
        assert (
            "nothing is written" in printed(capsys, *STOVE, "--embedding", str(folder), *out)
        ) != bool(out)
    for out in ([str(folder)], [str(folder.parent / "other")]):
        with pytest.raises(SystemExit, match="--out"):
            main([*STOVE, "--embedding", "home", "--out", *out])
    assert files(folder) == before
    assert best(capsys, "stove", "atLocation", embedding="copy")[0] == ("kitchen", True)


def test_facts_are_observed_and_taken_back_until_nothing_is_left(
    capsys: pytest.CaptureFixture[str],
) -> None:
    printed(capsys, *HOB)
    effect = parsed(capsys, *TO_HOB, "--fact", "bed", "atLocation", "bedroom")
    assert (effect["updated"], effect["facts"], effect["known"]) == (["hob"], 1, 1)
    assert best(capsys, "hob", "hasAffordance")[0] == ("turn on", True)
    printed(capsys, "remove", *TO_HOB[1:])
    assert not any(given for _, given in best(capsys, "hob", "hasAffordance"))
    assert "hob" in printed(capsys, "remove", "hob")
    assert "hob" in printed(capsys, "undo")
    assert best(capsys, "hob", "atLocation")[0] == ("kitchen", True)
    for _ in range(3):
        printed(capsys, "undo")
    changes = parsed(capsys, "history")["changes"]
    assert [change["change"] for change in changes] == [
        "insert",
        "observe",
        "remove",
        "remove",
        *["undo"] * 4,
    ]
    with pytest.raises(SystemExit, match="undo"):
        printed(capsys, "undo")
    assert "nothing has changed" in printed(
        capsys, "observe", "--fact", "bed", "atLocation", "bedroom"
    )
    assert "nothing has changed" not in printed(
        capsys, "observe", "--fact", "bed", "atLocation", "kitchen"
    )


def test_what_is_new_in_files_is_inserted_and_what_is_known_is_counted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = (
        "Stove,atLocation,kitchen\nKettle,atLocation,kitchen\nkettle,atLocation,bedroom\n"
        "Stove,hasAffordance,turn on\nbed,atLocation,bedroom\n"
    )
    Path("facts.csv").write_text(f"head,relation,tail\n{rows}", encoding="utf-8")
    Path("more.csv").write_text("head,relation,tail\nhob,atLocation,kitchen\n", encoding="utf-8")
    command = ["insert", "--from", "facts.csv", "--from", "more.csv"]
    effect = parsed(capsys, *command)
    assert (sorted(effect["inserted"]), effect["facts"], effect["known"]) == (
        ["Kettle", "Stove", "hob"],
        5,
        1,
    )
    assert best(capsys, "Stove", "hasAffordance")[0] == ("turn on", True)
    assert best(capsys, "kettle", "atLocation") == [("bedroom", True), ("kitchen", False)]
    again = parsed(capsys, *command)
    assert (again["inserted"], again["updated"], again["facts"], again["known"]) == ([], [], 0, 6)


@pytest.mark.parametrize(
    ("command", "note"),
    [
        (["ask", "KETTLE", "at location"], ["'kettle'", "'atLocation'"]),
        (["ask", "--relation", "hasAffordance", "--tail", "turnOn"], ["'turn on'"]),
        (["nearest", "Kettle"], ["'kettle'"]),
        (["explain", "gas-hob"], ["'gas hob'"]),
        (["interference", "GasHob"], ["'gas hob'"]),
    ],
)
def test_a_question_in_another_spelling_is_answered_and_says_what_it_is_about(
    capsys: pytest.CaptureFixture[str], command: list[str], note: list[str]
) -> None:
    printed(capsys, "insert", "gas hob", "--fact", "atLocation", "kitchen")
    main([*command, "--embedding", "home"])
    lines = capsys.readouterr().err.splitlines()
    assert [name in line for name, line in zip(note, lines, strict=True)] == [True] * len(note)


def test_an_initializer_takes_options(capsys: pytest.CaptureFixture[str]) -> None:
    for k in (1, 2):
        out = ["--out", f"larger {k}"]
        result = parsed(capsys, *STOVE, "--initializer", "rs", "--set", f"k={k}", *out)
        assert [
            indicator["weight"] for indicator in result["indicators"] if indicator["weight"]
        ] == [1 / k] * k
        assert read(Path(out[1])).insertions()["stove"].options == {"k": k}


def test_a_copy_does_not_replace_other_changes(capsys: pytest.CaptureFixture[str]) -> None:
    printed(capsys, *STOVE, "--out", "larger")
    for text in (None, '"version": 2', "{", "[]"):
        manifest = Path("larger/embedding.json")
        if text:
            manifest.write_text(
                manifest.read_text("utf-8").replace('"version": 1', text) if ":" in text else text
            )
        before = files(Path("larger"))
        with pytest.raises(SystemExit, match=r"larger\b.*: already holds a bundle"):
            printed(capsys, *HOB, "--out", "larger")
        assert files(Path("larger")) == before


def test_a_file_of_word_vectors_serves_all_phrases_of_a_copy(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = word_file(Path("other.txt"), {"kettle": [1, 0], "bed": [0, 1], "gas stove": [0.8, 0.6]})
    result = parsed(
        capsys,
        "insert",
        "gasStove",
        "--vectors",
        str(path),
        "--initializer",
        "es",
        "--out",
        "larger",
    )
    assert [indicator["entity"] for indicator in result["indicators"]] == ["kettle", "bed"]
    assert result["indicators"][0]["words"] == pytest.approx(0.8)
    assert str(path) in result["words"]
    assert (
        parsed(capsys, "explain", "gasStove", "--embedding", "larger")["indicators"]
        == result["indicators"]
    )
    with pytest.raises(SystemExit, match="--vectors"):
        printed(capsys, *STOVE, "--vectors", str(path))


# ask, nearest, explain, interference


def test_each_part_of_a_triple_is_predicted(capsys: pytest.CaptureFixture[str]) -> None:
    heads = parsed(capsys, "ask", "--relation", "atLocation", "--tail", "bedroom")
    assert heads["query"] == ["?", "atLocation", "bedroom"]
    assert [
        (answer["entity"], answer["score"], answer["known"]) for answer in heads["answers"]
    ] == [
        ("bed", 2.0, True),
        ("kettle", 1.0, False),
    ]
    by_option = parsed(capsys, "ask", "--head", "bed", "--relation", "atLocation")
    assert by_option == parsed(capsys, "ask", "bed", "atLocation")
    relations = parsed(capsys, "ask", "kettle", "--tail", "kitchen")
    assert [answer["entity"] for answer in relations["answers"]] == ["atLocation", "hasAffordance"]
    assert relations["sure"] is True
    assert printed(capsys, "ask", "kettle", "atLocation").splitlines()[1].split() == [
        "kitchen",
        "(known)",
    ]


def test_what_is_unlikely_is_said_not_to_be_known(capsys: pytest.CaptureFixture[str]) -> None:
    """Equal scores have the share of known answers as probability: a few of a hundred."""
    names = [f"thing {number}" for number in range(10)]
    triples = np.array([(0, 0, 1), (2, 0, 3), (4, 1, 5)])
    dull = small(
        entities=np.ones((10, 4), np.float32),
        entity_names=names,
        kinds=[""] * 10,
        phrases=names,
        triples=triples,
        words=None,
    )
    written(Path("dull"), dull)
    unlikely = parsed(capsys, "ask", "thing 7", "atLocation", "--embedding", "dull")
    assert unlikely["sure"] is False
    assert 0 < unlikely["answers"][0]["probability"] < 0.3
    assert "do not know" in printed(capsys, "ask", "thing 7", "atLocation", "--embedding", "dull")
    assert parsed(capsys, "ask", "thing 0", "atLocation", "--embedding", "dull")["sure"] is True


def test_neighbours_are_those_of_largest_cosine(capsys: pytest.CaptureFixture[str]) -> None:
    neighbours = parsed(capsys, "nearest", "kettle", "--top", "2")["nearest"]
    assert [(entity["entity"], entity["kind"]) for entity in neighbours] == [
        ("kitchen", "room"),
        ("turn on", "affordance"),
    ]
    assert neighbours[0]["cosine"] == pytest.approx(3 / np.sqrt(14))


def test_an_explanation_and_its_text_have_the_largest_change_first(
    capsys: pytest.CaptureFixture[str],
) -> None:
    printed(capsys, *STOVE)
    explained = parsed(capsys, "explain", "stove")
    moved = [piece["moved"] for piece in explained["without"]]
    assert moved == sorted(moved, reverse=True)
    assert {piece["what"] for piece in explained["without"] if piece["left_out"] == "fact"} == {
        "stove atLocation kitchen",
        "stove hasAffordance turn on",
    }
    text = printed(capsys, "explain", "stove")
    assert "stove atLocation kitchen" in text
    assert len(text.splitlines()) <= 15
    assert all(
        piece["what"] in printed(capsys, "explain", "stove", "--verbose")
        for piece in explained["without"]
    )


def test_interference_is_of_all_insertions_or_of_those_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    first = parsed(capsys, *STOVE)["interference"]
    result = parsed(capsys, *HOB, "--top", "2")
    both, one = result["interference_of_all"], result["interference"]
    assert first["queries"] == both["queries"] == one["queries"] == 8  # of the triples of training
    assert first["h_old"] == both["h_old"] >= one["h_cur"] >= both["h_cur"]
    assert parsed(capsys, "interference", "--top", "2") == both
    assert parsed(capsys, "interference", "hob", "--top", "2") == one
    assert parsed(capsys, "interference", "stove") == first
    written(Path("bare"), small(triples=np.zeros((0, 3), np.int64), words=None))
    assert parsed(capsys, *STOVE, "--embedding", "bare")["interference_of_all"] is None


# The command itself


def test_text_has_a_line_for_each_key_and_tables_without_empty_columns() -> None:
    answer = {
        "the_query": ("a", "in", "?"),
        "share": 0.12345,
        "no_words": None,
        "is_known": True,
        "names": ["b", "c"],
        "rows": [
            {"entity": "b", "weight": None, "cosine": 1.0},
            {"entity": "long", "weight": None, "cosine": None},
        ],
        "parts": [{"of": ("a", "on", "?"), "rows": [{"x": 1}]}],
        "counts": {"c": 3},
    }
    assert list(lines(answer)) == [
        "the query: a in ?",
        "share: 0.123",
        "no words: –",
        "is known: yes",
        "names: b, c",
        "rows:",
        "  entity  cosine",
        "  b       1",
        "  long    –",
        "parts:",
        "  of: a on ?",
        "  rows:",
        "    x",
        "    1",
        "counts:",
        "  c: 3",
    ]


def test_help_loads_nothing_that_is_slow() -> None:
    code = (
        "import sys; from isi.__main__ import main\n"
        f"for command in {[[], *map(str.split, COMMANDS)]}: main([*command, '--help'])\n"
        "print(sorted({'torch', 'pandas', 'gensim', 'isi.live.embedding'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.endswith("[]\n")
    assert {f"{command}:" for command in COMMANDS} <= set(done.stdout.split())


def test_a_closed_pipe_gives_no_traceback(home: Path) -> None:
    nearest = shlex.join([sys.executable, "-m", "isi", "nearest", "bed", "--embedding", str(home)])
    command = f"{nearest} | true"  # which reads nothing
    done = subprocess.run(  # noqa: S602
        command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""


def test_a_terminal_that_lacks_a_letter_shows_its_number(tmp_path: Path) -> None:
    home = written(tmp_path / "abroad", replace(small(), entity_names=[*NAMES[:-1], "naïve"]))
    command = ["nearest", "bed", "--embedding", str(home)]
    code = f"from isi.__main__ import main; main({command}); main({[*command, '--json']})"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert r"na\xefve" in done.stdout
    assert r'"na\u00efve"' in done.stdout


def test_an_interrupt_gives_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("isi.cli.entity.open_folder", lambda _: signal.raise_signal(signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(SystemExit) as ended:
            main(["nearest", "bed", "--embedding", "home"])
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.value.code == 130
    said = "isi nearest: stopped by SIGINT; no file is half-written; run it again\n"
    assert capfd.readouterr() == ("", said)


def test_another_python_than_that_of_the_environment_says_so_in_one_line() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-S", "-m", "isi", "history"]
    ended = subprocess.run(
        command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    assert re.fullmatch(
        r"isi: .+ lacks the package \w+: activate \.venv, or use its `isi`\n", ended.stderr
    )
