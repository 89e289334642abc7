"""Labels, glossary and summary of the page."""

from pathlib import Path

import pytest

from isi.errors import InputError
from isi.report import data, glossary, page
from isi.report.figures import in_words
from isi.report.glossary import Marker, Term
from isi.report.sections import immediate
from isi.report.tables import Column, ReportTable
from isi.report.words import SCOPES
from tests.reports import of_experiment, small_results


def test_headers_and_cells_are_words_on_the_page() -> None:
    scope = Column("scope", words=SCOPES)
    table = ReportTable.of(
        "t", [{scope: "known", Column("entity half", "all"): 1, Column("away", title="the graph"): 2}]
    )
    assert [page.header(column) for column in table.columns] == ["queries", "entity prediction", "the graph"]
    assert page.column_groups(table) == [("", 1), ("all queries", 1), ("", 1)]
    assert page.column_groups(ReportTable.of("t", [{"a": 1}])) == []
    assert table.columns[0].words["known"] == "earlier knowledge"


def test_a_word_is_marked_where_it_first_stands_in_a_part_and_only_as_a_word() -> None:
    marker = Marker([Term("seed", "One repeat.", ("seeds",)), Term("Mean", "The centre.", in_text=False)])
    link = '<a class="term" href="#term-seed">seeds</a>'
    assert marker.text("Over seeds, by seed.") == f"Over {link}, by seed."
    assert marker.anew() == ""
    assert marker.text("reseeds <code>seed</code> <a href='#x'>seeds</a> seeds") == (
        f"reseeds <code>seed</code> <a href='#x'>seeds</a> {link}"
    )
    assert marker.text("Mean epochs") == "Mean epochs"
    assert marker.cell_text("Mean") == '<a class="term" href="#term-mean">Mean</a>'
    assert marker.cell_text("Mean") == "Mean"
    assert marker.cell_text("<b>") == "&lt;b&gt;"


def test_every_word_has_a_place_of_its_own_and_every_initializer_is_explained() -> None:
    results = small_results(["home"])
    words = [*glossary.of_the_page(), *glossary.of_models(results)]
    ids = [term.id for term in words]
    assert len(set(ids)) == len(ids)
    assert all(one.isascii() for one in ids)
    assert all(term.means.endswith(".") for term in words)
    explained = {term.name: term.means for term in words}
    assert {"Xavier", "ES", "Permuted ES", "Joint"} <= set(explained)
    assert explained["ES"].startswith("Entity similarity: ")


def test_links_lead_to_what_is_there_and_weight_is_marked_up() -> None:
    text = "**Yes.** See [this](#one), [that](#two) and [a paper](https://arxiv.org/abs/1); 2 * 3 ** 2."
    assert page.marked_up(text, {"one"}) == (
        '<strong>Yes.</strong> See <a href="#one">this</a>, that and <a href="https://arxiv.org/abs/1">a paper</a>; '
        "2 * 3 ** 2."
    )


def test_the_verdict_is_in_numbers_of_the_first_graph() -> None:
    results = small_results(["home", "away"])
    part, home = page.VERDICT.filled(results), results.experiments["home"]
    assert part
    sentences, figure = part.blocks
    assert len(sentences.items) == 3  # neither the kind's centre nor any initializer beyond the paper was run
    given = {model: estimate.mean for model, estimate in home.given_means.items()}
    best = max(("es", "rs", "ers"), key=lambda name: given[name])
    assert f"has {given[best]:.1f} in entity prediction, Xavier {given['xavier']:.1f}" in sentences.items[1]
    now = 100 * home.immediate[home.immediate["scope"] == "all"].groupby("model")["mrr_star"].mean()
    assert f"{now[best]:.1f} points of 100 and Xavier of {now['xavier']:.1f}" in sentences.items[0]
    assert f"Joint {given['joint']:.1f}" in in_words(figure.content.canvas)


def test_those_that_gain_do_so_with_an_interval_above_zero() -> None:
    results = small_results(["home"])
    home = results.experiments["home"]
    start = home.runs["epoch"] == 0

    def gained(**points: float) -> list[str]:
        runs = home.runs.copy()
        for model in ("xavier", "es", "rs", "ers"):
            runs.loc[start & (runs["model"] == model), "mrr_star"] = 0.5 + points.get(model, 0)
        (content,) = immediate.verdict(of_experiment(results, "home", runs=runs))
        return list(content.numbers["answer"])

    assert gained(es=0.2, rs=0.2, ers=0.2) == ["es", "rs", "ers"]
    assert gained(es=0.2, ers=-0.1) == ["es"]
    assert gained() == []


def test_there_is_no_verdict_where_there_is_nothing_to_compare() -> None:
    assert page.VERDICT.filled(small_results(["moved"])) is None
    home = small_results(["home"])
    assert page.VERDICT.filled(of_experiment(home, "home", initializers=["xavier", "iu"])) is None


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"phrase,definition\nmug,a cup\nbed\n", "line 3: expected "),
        (b"phrase,meaning\nmug,a cup\n", "line 1: expected .*phrase, definition"),
        (b"phrase,definition\nmug,a c\xffp\n", "line 2: expected .*UTF-8"),
    ],
)
def test_definitions_that_are_broken_are_one_line(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "definitions.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"^{path}: {said}[^\n]*$"):
        data.read_definitions(path)
