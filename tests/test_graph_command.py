"""``isi graph`` on a user's files: the graph, the printed description, and refused input."""

import gzip
import json
from pathlib import Path

import pytest

from isi.__main__ import main
from isi.cli.graph import describe, guess, read, together
from isi.config import read as read_params
from isi.graph.graph import ENTITIES, TRIPLES, build_graph, build_tables
from isi.tables import paths

ROOT = Path(__file__).parent.parent
LOG = """head,relation,tail,count,room
mug,atLocation,kitchen,3,kitchen
mug,atLocation,kitchen,1,
mug,hasMaterial,ceramic,2,
cup,atLocation,kitchen,1,kitchen
cup,hasAffordance,fill,1,
mug,hasAffordance,fill,1,
xqzzy,atLocation,bedroom,1,bedroom
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the params and the shipped data, which is the current folder."""
    (tmp_path / paths.PARAMS).write_bytes((ROOT / paths.PARAMS).read_bytes())
    (tmp_path / paths.DATA).mkdir()
    (tmp_path / paths.RAW).symlink_to(ROOT / paths.RAW)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(LOG, encoding="utf-8")
    return tmp_path


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The output of the command."""
    main(["graph", *arguments])
    return capsys.readouterr().out


def test_it_describes_the_graph_of_a_table(folder: Path) -> None:
    (name, _, seen) = read(folder / "log.csv", None, {"household": True}, 0)
    assert name == "table"
    assert describe(build_tables(seen), read_params(paths.PARAMS)) == {
        "entities": 7, "unique_triples": 6, "observations": 10,
        "entities_by_kind": {"object": 3, "room": 2, "affordance": 1, "material": 1},
        "relations": [
            {"relation": "atLocation", "unique_triples": 3, "observations": 6},
            {"relation": "hasAffordance", "unique_triples": 2, "observations": 2},
            {"relation": "hasMaterial", "unique_triples": 1, "observations": 2},
        ],
        "without_a_word_vector": "1 (xqzzy)", "with_one_triple,_which_stays_in_train": "3 (bedroom, ceramic, xqzzy)",
        "triples_observed_once": 4, "triples_for_validation_and_test": 2, "triples_that_can_leave_train": 1,
    }  # fmt: skip


def test_it_writes_the_tables_of_a_graph(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said(capsys, "log.csv", "--out", "made/graph")
    entities = ENTITIES.read_file(folder / "made/graph/entities.parquet")
    triples = TRIPLES.read_file(folder / "made/graph/triples.parquet")
    assert list(entities["entity"]) == ["bedroom", "ceramic", "cup", "fill", "kitchen", "mug", "xqzzy"]
    assert set(entities["kind"]) == {"entity"}
    counts = {tuple(row[:3]): row[3] for row in triples.itertuples(index=False)}
    assert counts["mug", "atLocation", "kitchen"] == 4
    assert sum(counts.values()) == 10
    assert build_graph(entities, triples).triples.shape == (6, 3)
    assert {path.name for path in (folder / "made/graph").iterdir()} == {"entities.parquet", "triples.parquet"}


def test_several_files_make_one_graph_whose_rare_triples_can_be_left_out(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "more.nt").write_text("<urn:x:mug> <urn:x:atLocation> <urn:x:kitchen> .\n", encoding="utf-8")
    text = said(capsys, "log.csv", "more.nt")
    assert text.startswith("log.csv:\n  reader: table\nmore.nt:\n  reader: rdf\nentities: 7\nunique triples: 6\n")
    assert "entities: 3\nunique triples: 2\nobservations: 6\n" in said(capsys, "log.csv", "--min-count", "2")


def test_a_graph_that_can_be_split_is_described_so(folder: Path) -> None:
    rows = [f"thing{h},near,thing{t}" for h in range(9) for t in range(9)]
    (folder / "dense.csv").write_text("head,relation,tail\n" + "\n".join(rows), encoding="utf-8")
    graph = build_tables(together([read(folder / "dense.csv", None, {}, 0)[2]]))
    described = describe(graph, read_params(paths.PARAMS))
    assert (described["triples_for_validation_and_test"], described["triples_that_can_leave_train"] >= 16) == (16, True)
    assert described["with_one_triple,_which_stays_in_train"] == "0"
    listed = "9 (thing0, thing1, thing2, thing3, thing4, thing5, thing6, thing7, and 1 more)"
    assert described["without_a_word_vector"] == listed


# Which reader


SCENE = [{"objectType": "Mug", "objectId": "Mug|1", "parentReceptacles": ["SideTable|1"]}]
HOUSE = {"rooms": [], "objects": []}


@pytest.mark.parametrize(
    ("name", "content", "reader"),
    [
        ("a.csv", "", "table"), ("a.tsv.gz", "", "table"), ("a.parquet", "", "table"),
        ("a.nt", "", "rdf"), ("a.ttl.gz", "", "rdf"),
        ("a.json", SCENE, "ai2thor_scene"), ("a.json", {"metadata": {"objects": SCENE}}, "ai2thor_scene"),
        ("a.jsonl", {"scene": "FloorPlan1", "spawn": None, "objects": SCENE}, "ai2thor_scene"),
        ("a.json", HOUSE, "procthor_houses"), ("a.jsonl.gz", HOUSE, "procthor_houses"),
        ("a.jsonl.gz", {"format": "isi recording", "version": 1}, "ai2thor"), ("a.json", {"kitchens": []}, "ai2thor"),
    ],
)  # fmt: skip
def test_the_reader_is_guessed_from_the_name_or_the_keys(
    tmp_path: Path, name: str, content: object, reader: str
) -> None:
    path, text = tmp_path / name, json.dumps(content, indent=1 if name == "a.json" else None).encode()
    path.write_bytes(gzip.compress(text) if name.endswith(".gz") else text)
    assert guess(path) == reader
