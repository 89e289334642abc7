"""Labels, glossary and links of the page."""

from pathlib import Path

import pytest

from isi.errors import InputError
from isi.report import data, glossary, page
from isi.report.glossary import Marker, Term
from isi.report.tables import Column, ReportTable
from isi.report.words import SCOPES
from tests.reports import small_results


def test_headers_and_cells_are_words_on_the_page() -> None:
    scope = Column("scope", words=SCOPES)
    table = ReportTable.of(
        "t",
        [{scope: "known", Column("entity half", "all"): 1, Column("away", title="the graph"): 2}],
    )
    assert [page.header(column) for column in table.columns] == [
        "queries",
        "entity prediction",
        "the graph",
    ]
    assert page.column_groups(table) == [("", 1), ("all queries", 1), ("", 1)]
    assert page.column_groups(ReportTable.of("t", [{"a": 1}])) == []
    assert table.columns[0].words["known"] == "earlier knowledge"


def test_a_word_is_marked_where_it_first_stands_in_a_part_and_only_as_a_word() -> None:
    marker = Marker(
        [Term("seed", "One repeat.", ("seeds",)), Term("Mean", "The centre.", in_text=False)]
    )
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
    text = (
        "**Yes.** See [this](#seed), [that](#two) and [a paper](https://arxiv.org/abs/1); "
        "2 * 3 ** 2, MRR* of 3*k* < `a*b*`; seeds."
    )
    marker = Marker([Term("seed", "One repeat.", ("seeds",))])
    assert page.marked_up(page.MARKDOWN.renderInline, marker, {"seed"}, text) == (
        '<strong>Yes.</strong> See <a href="#seed">this</a>, '
        'that and <a href="https://arxiv.org/abs/1">a paper</a>; '
        "2 * 3 ** 2, MRR* of 3<em>k</em> &lt; <code>a*b*</code>; "
        '<a class="term" href="#term-seed">seeds</a>.'
    )
    html = page.marked_up(page.MARKDOWN.render, marker, set(), "- <b>\n- nan [nan, nan]")
    assert html.split() == ["<ul>", "<li>&lt;b&gt;</li>", "<li>–</li>", "</ul>"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"phrase,definition\nmug,a cup\nbed\n", "line 3: expected "),
        (b"phrase,meaning\nmug,a cup\n", "line 1: expected .*phrase, definition"),
        (b"phrase,definition\nmug,a c\xffp\n", "line 2: expected .*UTF-8"),
    ],
)
def test_definitions_that_are_broken_are_one_line(
    tmp_path: Path, content: bytes, said: str
) -> None:
    path = tmp_path / "definitions.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"^{path}: {said}[^\n]*$"):
        data.read_definitions(path)
