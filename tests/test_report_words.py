"""What the page calls things, what it explains, and what it answers first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from isi.errors import InputError
from isi.report import glossary, page, results, summary
from isi.report.figures import in_words
from isi.report.glossary import Marker, Term
from isi.report.section import Heading
from isi.report.wording import cell, header
from tests.reports import small_results


@pytest.mark.parametrize(
    ("column", "shown"),
    [
        ("MRR*", ("", "MRR*")),
        ("all: entity half", ("all queries", "asks for entities")),
        ("novel_heldout: unconverged %", ("novel entities, held out", "never converged, %")),
        ("epochs, novel_heldout: mean", ("epochs: novel entities, held out", "mean")),
        ("scope novel", ("", "novel entities")),
        ("immediate MRR*, scope all", ("", "immediate MRR*, all queries")),
        ("known", ("", "earlier knowledge")),
        ("MRR* at the end", ("at the end", "MRR*")),
        ("entity half: all true", ("asks for entities", "all true triples left out")),
        ("×0.5: mean", ("×0.5", "mean")),
        ("away", ("", "the other graph")),
        ("allies", ("", "allies")),
    ],
)
def test_headers_are_words_and_say_what_they_share(column: str, shown: tuple[str, str]) -> None:
    assert header(column, {"away": "the other graph"}) == shown


def test_cells_of_scopes_measures_and_experiments_are_words() -> None:
    titles = {"away": "the other graph"}
    assert cell("scope", "known_closed", titles) == "earlier knowledge by itself"
    assert cell("measure", "known, epoch 150", titles) == "earlier knowledge, epoch 150"
    assert cell("measure", "epochs to convergence, scope all", titles) == "epochs to convergence, all queries"
    assert cell("experiment", "away", titles) == "the other graph"
    assert cell("entity", "all", titles) == "all"


def test_a_word_is_marked_where_it_first_stands_in_a_part_and_only_as_a_word() -> None:
    marker = Marker([Term("seed", "One repeat.", ("seeds",)), Term("Mean", "The centre.", in_text=False)])
    link = '<a class="term" href="#term-seed">seeds</a>'
    assert marker.text("Over seeds, by seed.") == f"Over {link}, by seed."
    assert marker.anew() == ""
    assert marker.text("reseeds <code>seed</code> <a href='#x'>seeds</a> seeds") == (
        f"reseeds <code>seed</code> <a href='#x'>seeds</a> {link}"
    )
    assert marker.text("Mean epochs") == "Mean epochs"
    assert marker.cell("Mean") == '<a class="term" href="#term-mean">Mean</a>'
    assert marker.cell("Mean") == "Mean"
    assert marker.cell("<b>") == "&lt;b&gt;"


def test_every_word_has_a_place_of_its_own_and_every_initializer_is_explained() -> None:
    results = small_results(["home"])
    words = glossary.terms(results)
    ids = [term.id for term in words]
    assert len(set(ids)) == len(ids)
    assert all(one.isascii() for one in ids)
    assert all(term.means.endswith(".") for term in words)
    explained = {term.name: term.means for term in words}
    assert {"Xavier", "ES", "Permuted ES", "Joint"} <= set(explained)
    assert explained["ES"] == "Entity similarity: near what goes by a similar name."


def test_links_lead_to_what_is_there_and_weight_is_marked_up() -> None:
    text = "**Yes.** See [this](#one), [that](#two) and [a paper](https://arxiv.org/abs/1); 2 * 3 ** 2."
    assert page.marked_up(text, {"one"}) == (
        '<strong>Yes.</strong> See <a href="#one">this</a>, that and <a href="https://arxiv.org/abs/1">a paper</a>; '
        "2 * 3 ** 2."
    )


def test_contents_stand_under_their_headings() -> None:
    opened, folded = Heading("One"), Heading("Two", folded=True)
    assert page.parts(["a", opened, "b", "c", folded]) == [(None, ["a"]), (opened, ["b", "c"]), (folded, [])]
    assert page.parts([]) == []


def test_the_verdict_is_in_numbers_of_the_first_graph() -> None:
    results = small_results(["home", "away"])
    found, home = summary.verdict(results), results.experiments["home"]
    assert len(found.sentences) == 3  # neither who knows the kind nor anyone of later was run
    about = summary.asked_about(results, home)["mean"]
    best = max(("es", "rs", "ers"), key=lambda name: about[name])
    assert f"has {about[best]:.1f}, Xavier {about['xavier']:.1f}" in found.sentences[1]
    now = 100 * home.at_once[home.at_once["scope"] == "all"].groupby("model")["mrr_star"].mean()
    assert f"{now[best]:.1f} points of 100 and Xavier of {now['xavier']:.1f}" in found.sentences[0]
    assert found.figure
    assert f"Joint {about['joint']:.1f}" in in_words(found.figure.canvas)


def test_the_answer_is_yes_only_where_all_gain_for_certain() -> None:
    home = small_results(["home"]).experiments["home"]
    at_once = home.runs["epoch"] == 0

    def gained(**points: float) -> str:
        runs = home.runs.copy()
        for model in ("xavier", "es", "rs", "ers"):
            runs.loc[at_once & (runs["model"] == model), "mrr_star"] = 0.5 + points.get(model, 0)
        return summary.answer(replace(home, runs=runs))

    assert gained(es=0.2, rs=0.2, ers=0.2) == "Yes."
    assert gained(es=0.2, ers=-0.1) == "In part: ES for certain."
    assert gained() == "Not for certain."


def test_there_is_no_verdict_where_there_is_nothing_to_compare() -> None:
    moved = small_results(["moved"])
    assert summary.verdict(moved) == summary.Verdict([], None)
    home = small_results(["home"])
    alone = replace(home.experiments["home"], initializers=["xavier", "iu"])
    assert summary.verdict(replace(home, experiments={"home": alone})).sentences == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"phrase,definition\nmug,a cup\nbed\n", "line 3: expected 2 fields, got 1"),
        (b"phrase,meaning\nmug,a cup\n", "line 1: expected the columns phrase, definition; got 'phrase', 'meaning'"),
        (b"phrase,definition\nmug,a c\xffp\n", "line 1: expected a table of UTF-8 text"),
    ],
)
def test_definitions_that_are_broken_are_one_line(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "definitions.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=said):
        results.read_definitions(path)


def test_definitions_are_read_with_a_byte_order_mark_and_not_as_numbers(tmp_path: Path) -> None:
    path = tmp_path / "definitions.csv"
    path.write_bytes("\ufeffphrase,definition\nNA,1\n".encode())
    assert results.read_definitions(path).to_dict("list") == {"phrase": ["NA"], "definition": ["1"]}
