"""``isi export``: files that other tools can read, and predictions of missing triples."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import networkx as nx
import pandas as pd
import pytest
from rdflib import RDF, RDFS, Graph, Literal, URIRef

import isi
from isi.__main__ import main
from isi.cli.export import FORMATS
from isi.graph.files import read_graph
from tests.observing import TRIPLE
from tests.small_bundle import home_of, small
from tests.small_experiment import ENTITIES, TRIPLES, write_experiment, write_model

ROOT = Path(__file__).parent.parent
ROWS = set(TRIPLES[TRIPLE].itertuples(index=False, name=None))
#: Best missing triples by hand, best first: with DistMult, (?, atLocation, ?) compares second
#: coordinates.
BEST = [
    ("mug", "atLocation", 'Öfen 5"', 3.0, 1),
    ("mug", "atLocation", "mug", 1.0, 2),
    ("tea/pot", "atLocation", 'Öfen 5"', 3.0, 1),
    ("tea/pot", "atLocation", "mug", 1.0, 2),
    ('Öfen 5"', "atLocation", 'Öfen 5"', 9.0, 1),
    ('Öfen 5"', "atLocation", "kitchen", 3.0, 2),
    ("mug", "hasAffordance", "tea/pot", 2.0, 1),
    ("mug", "hasAffordance", "mug", 1.0, 2),
    ("tea/pot", "hasAffordance", "tea/pot", 4.0, 1),
    ("tea/pot", "hasAffordance", "fill", 2.0, 2),
    ('Öfen 5"', "hasAffordance", "fill", 0.0, 1),
    ('Öfen 5"', "hasAffordance", "kitchen", 0.0, 2),
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the small experiment and a model of it, which is the current folder."""
    monkeypatch.chdir(tmp_path)
    write_experiment()
    write_model(Path("models/home"))
    return tmp_path


def export(form: str, out: str, *more: str) -> None:
    main(["export", "home", "--format", form, "--out", out, *more])


def predict(form: str, out: str, number: int, *more: str) -> None:
    of_model = ["export", "--home", "models/home", "--predictions", str(number)]
    main([*of_model, "--format", form, "--out", out, *more])


# What other tools find


@pytest.mark.usefixtures("folder")
def test_rdf_tells_kinds_phrases_and_predictions_where_they_are_asked_for() -> None:
    predict("turtle", "home", 1, "--labels")
    read = Graph().parse("home", format="turtle")
    mug, first = URIRef("urn:isi:home:entity:mug"), URIRef("urn:isi:home:prediction:1")
    assert len(read) == len(TRIPLES) + 2 * len(ENTITIES) + 5 * 6
    assert read.value(mug, RDFS.label) == Literal("mug")
    assert read.value(mug, RDF.type) == URIRef("urn:isi:home:kind:object")
    assert read.value(first, RDF.subject) == mug
    assert read.value(first, URIRef("urn:isi:home:prediction:score")).toPython() == 3.0  # type: ignore[union-attr]
    assert read.value(first, URIRef("urn:isi:home:prediction:rank")).toPython() == 1  # type: ignore[union-attr]


@pytest.mark.usefixtures("folder")
def test_graphml_opens_in_networkx() -> None:
    predict("graphml", "home.graphml", 2)
    read = nx.read_graphml("home.graphml", force_multigraph=True)
    edges = sorted(read.edges(data=True), key=lambda edge: "rank" in edge[2])
    counted = {
        (head, data["relation"], tail): data["count"]
        for head, tail, data in edges
        if "count" in data
    }
    assert counted == dict.fromkeys(ROWS, 1)
    expected = {
        (head, data["relation"], tail, data["score"], data["rank"])
        for head, tail, data in edges
        if "rank" in data
    }
    assert expected == set(BEST)
    assert read.nodes["mug"] == {"kind": "object", "phrase": "mug"}
    assert len({key for *_, key in read.edges(keys=True)}) == len(edges)


@pytest.mark.usefixtures("folder")
def test_pykeen_reads_the_triples() -> None:
    pytest.importorskip("pykeen")
    from pykeen.triples import TriplesFactory

    predict("pykeen-tsv", "home.tsv", 2)
    factory = TriplesFactory.from_path("home.tsv")
    assert factory.num_triples == len(TRIPLES)
    assert {tuple(row) for row in factory.label_triples(factory.mapped_triples)} == ROWS
    predicted = pd.read_csv("home.predictions.tsv", sep="\t", header=None)
    assert list(predicted.itertuples(index=False, name=None)) == BEST


def test_the_same_graph_is_the_same_bytes_whatever_order_hashes_give(folder: Path) -> None:
    (folder / "isi").symlink_to(ROOT / "isi")
    options = ["--home", "models/home", "--labels", "--predictions", "2"]
    for form in FORMATS:
        main(["export", "--format", form, "--out", f"here/{form}", *options])
    calls = [["export", "--format", form, "--out", f"there/{form}", *options] for form in FORMATS]
    code = f"from isi.__main__ import main\nfor call in {calls}: main(call)"
    subprocess.run(
        [sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONHASHSEED": "1"}
    )
    here, there = (
        {
            path.relative_to(place): path.read_bytes()
            for path in Path(place).rglob("*")
            if path.is_file()
        }
        for place in ("here", "there")
    )
    assert len(here) == 4
    assert here == there


# Predictions


def exported(home: str, most: int) -> tuple[set[tuple[str, ...]], list[tuple[Any, ...]]]:
    """The triples of a home, and ``most`` predictions for each head and relation."""
    command = ["export", "--home", home, "--format", "pykeen-tsv", "--out", "out.tsv"]
    main([*command, "--predictions", str(most), "--replace"])
    triples, predicted = (
        list(pd.read_csv(path, sep="\t", header=None).itertuples(index=False, name=None))
        for path in ("out.tsv", "out.predictions.tsv")
    )
    return set(triples), predicted


@pytest.mark.usefixtures("folder")
def test_a_home_leaves_with_what_holds_and_what_it_predicts_itself() -> None:
    """By hand: a kettle in the bedroom and a bed in the kitchen have score 1;
    known triples are left out, retracted ones are neither triples nor predicted.
    """
    known = small().named_triples()
    with isi.open(home_of(Path("small"))) as live:
        assert exported("small", 1) == (
            {*known},
            [
                ("kettle", "atLocation", "kettle", 10.0, 1),
                ("bed", "atLocation", "kettle", 5.0, 1),
                ("kettle", "hasAffordance", "kettle", 4.0, 1),
                ("bed", "hasAffordance", "bed", 4.0, 1),
            ],
        )
        live.remove(facts=known[:1])
    triples, predicted = exported("small", 9)
    assert triples == {*known[1:]}
    assert known[0] not in {row[:3] for row in predicted}


# Files that are read again


@pytest.mark.parametrize("predictions", [False, True])
@pytest.mark.parametrize(
    ("form", "out"),
    [
        ("turtle", "home.ttl"),
        ("graphml", "home.graphml"),
        ("pykeen-tsv", "home.tsv"),
        ("pykeen-tsv", "home.txt"),
    ],
)
def test_isi_graph_reads_what_isi_export_writes(
    folder: Path, form: str, out: str, predictions: bool
) -> None:
    if predictions:
        predict(form, out, 2, "--labels")
    else:
        export(form, out, "--labels")
    graph, read = read_graph([folder / out])
    assert set(graph.triples[TRIPLE].astype(str).itertuples(index=False, name=None)) == ROWS
    assert len(read) == 1
    if form == "graphml" and not predictions:  # other files and bundles hold no counts
        assert graph.triples["count"].sum() == TRIPLES["count"].sum()
    if form != "pykeen-tsv":
        kinds = dict(zip(ENTITIES["entity"], ENTITIES["kind"], strict=True))
        assert (
            dict(zip(graph.entities["entity"], graph.entities["kind"].astype(str), strict=True))
            == kinds
        )
