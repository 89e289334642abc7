"""``isi graph`` on a user's files: the graph, the printed description, and refused input."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.__main__ import main
from isi.cli.graph import describe
from isi.cli.output import write_outputs
from isi.config import read as read_params
from isi.errors import InputError
from isi.graph.files import graph_files, read_graph
from isi.graph.graph import MinedSource, build_tables
from isi.names import clean, name_fault
from isi.tables import paths
from tests.observing import TRIPLE

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
    graph, read = read_graph([folder / "log.csv"], settings={"household": True})
    assert read == {str(folder / "log.csv"): {"reader": "table"}}
    assert describe(graph, read_params(paths.PARAMS)) == {
        "entities": 7,
        "unique_triples": 6,
        "observations": 10,
        "entities_by_kind": {"object": 3, "room": 2, "affordance": 1, "material": 1},
        "relations": [
            {"relation": "atLocation", "unique_triples": 3, "observations": 6},
            {"relation": "hasAffordance", "unique_triples": 2, "observations": 2},
            {"relation": "hasMaterial", "unique_triples": 1, "observations": 2},
        ],
        "without_a_word_vector": "1 (xqzzy)",
        "with_one_triple,_which_stays_in_train": "3 (bedroom, ceramic, xqzzy)",
        "triples_observed_once": 4,
        "triples_for_validation_and_test": 2,
        "triples_that_can_leave_train": 1,
    }


def test_it_writes_a_folder_that_it_reads(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    described = said(capsys, "log.csv", "--set", "household=true", "--out", "made/graph")
    assert (folder / "made/graph/triples.csv").read_text(encoding="utf-8").splitlines()[:3] == [
        "head,relation,tail,count",
        "cup,atLocation,kitchen,1",
        "cup,hasAffordance,fill,1",
    ]
    assert {path.name for path in (folder / "made/graph").iterdir()} == {
        "entities.csv",
        "triples.csv",
    }
    read, written = described.split("written: ")
    assert written.split() == ["made/graph/triples.csv,", "made/graph/entities.csv"]
    assert said(capsys, "made/graph").replace("made/graph:", "log.csv:") == read


LETTERS = st.characters(categories=["L", "M", "N", "P", "S", "Zs"])
NAMES = (
    st.text(LETTERS, min_size=1, max_size=9).map(clean).filter(lambda text: not name_fault(text))
)


@given(st.dictionaries(st.tuples(NAMES, NAMES, NAMES), st.integers(1, 9), min_size=1), st.data())
def test_a_graph_that_is_written_reads_as_itself(
    tmp_path_factory: pytest.TempPathFactory,
    counts: dict[tuple[str, str, str], int],
    data: st.DataObject,
) -> None:
    names = sorted({name for head, _, tail in counts for name in (head, tail)})
    kinds, phrases = ({name: data.draw(NAMES) for name in names} for _ in range(2))
    described = pd.DataFrame({"entity": names, "kind": kinds.values(), "phrase": phrases.values()})
    rows = pd.DataFrame(
        [(*triple, count) for triple, count in counts.items()], columns=[*TRIPLE, "count"]
    )
    tables, folder = (
        build_tables(MinedSource("files", rows, described)),
        tmp_path_factory.getbasetemp() / "home",
    )
    contents = {folder / name: text for name, text in graph_files(tables).items()}
    write_outputs(contents, [], replace=True)
    again, _ = read_graph([folder])
    pd.testing.assert_frame_equal(again.triples, tables.triples)
    pd.testing.assert_frame_equal(again.entities, tables.entities)


def test_files_are_read_anywhere_with_the_packages_of_the_core_alone(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(LOG, encoding="utf-8")
    mug = {"objectType": "Mug", "objectId": "Mug|1", "parentReceptacles": None}
    scene = [mug | {"salientMaterials": ["Ceramic"], "sliceable": True}]
    (tmp_path / "scene.json").write_text(json.dumps(scene), encoding="utf-8")
    lacking = (
        "ai2thor",
        "dvc",
        "gensim",
        "matplotlib",
        "numba",
        "procthor",
        "pyarrow",
        "rdflib",
        "scipy",
    )
    code = f"""
import sys
sys.modules |= dict.fromkeys({lacking})
from isi.__main__ import main
main(["graph", "log.csv", "kitchen=scene.json", "--out", "out"])
main(["graph", "out"])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    # 10, and a mug's room, material and affordance
    assert done.stdout.count("observations: 13\n") == 2
    kinds = pd.read_csv(tmp_path / "out" / "entities.csv", index_col="entity")["kind"].to_dict()
    assert (kinds["mug"], kinds["bedroom"]) == ("object", "entity")


def test_several_files_make_one_graph_whose_rare_triples_can_be_left_out(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "more.nt").write_text(
        "<urn:x:mug> <urn:x:atLocation> <urn:x:kitchen> .\n", encoding="utf-8"
    )
    text = said(capsys, "log.csv", "more.nt")
    assert text.startswith(
        "log.csv:\n  reader: table\nmore.nt:\n  reader: rdf\nentities: 7\nunique triples: 6\n"
    )
    assert "entities: 3\nunique triples: 2\nobservations: 6\n" in said(
        capsys, "log.csv", "--min-count", "2"
    )


def test_a_graph_that_can_be_split_is_described_so(folder: Path) -> None:
    rows = [f"thing{h},near,thing{t}" for h in range(9) for t in range(9)]
    (folder / "dense.csv").write_text("head,relation,tail\n" + "\n".join(rows), encoding="utf-8")
    described = describe(read_graph([folder / "dense.csv"])[0], read_params(paths.PARAMS))
    assert (
        described["triples_for_validation_and_test"],
        described["triples_that_can_leave_train"] >= 16,
    ) == (16, True)
    assert described["with_one_triple,_which_stays_in_train"] == "0"
    listed = "9 (thing0, thing1, thing2, thing3, thing4, thing5, thing6, thing7, and 1 more)"
    assert described["without_a_word_vector"] == listed


# Paths


def test_a_path_may_hold_an_equals_sign_or_bytes_that_are_no_text(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("run=3/log.csv", os.fsdecode(b"d\xff/log.csv")):
        (folder / name).parent.mkdir()
        (folder / name).write_text(LOG, encoding="utf-8")
        assert "observations: 10" in said(capsys, name)


def test_bytes_that_are_no_text_are_printed_and_named_in_errors(folder: Path) -> None:
    good, bad, missing = (os.fsdecode(letter + b"\xff.csv") for letter in (b"d", b"e", b"f"))
    (folder / good).write_text(LOG, encoding="utf-8")
    (folder / bad).write_text("x\n", encoding="utf-8")
    code = """
import sys
from isi.__main__ import main
for name in sys.argv[1:]:
    try:
        main(["graph", name])
    except SystemExit as ended:
        print(ended, file=sys.stderr)
"""
    command = [sys.executable, "-c", code, good, bad, missing]
    done = subprocess.run(command, capture_output=True, check=True, cwd=folder)
    assert b"d\\udcff" in done.stdout
    assert done.stderr.count(b"\n") == 2
    assert b"e\\udcff" in done.stderr
    assert b"f\\udcff" in done.stderr


def test_a_file_that_is_given_twice_is_refused(folder: Path) -> None:
    (folder / "link.csv").symlink_to("log.csv")
    for files in (["log.csv", "log.csv"], ["log.csv", "./log.csv"], ["log.csv", "link.csv"]):
        with pytest.raises(InputError, match="twice"):
            read_graph(files)


def test_paths_and_kinds_are_printed_as_they_are(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "my_log.csv").write_text("mug,at,kitchen\n", encoding="utf-8")
    (folder / "my_kinds.csv").write_text(
        "entity,kind\nmug,kitchen_item\nkitchen,room_1\n", encoding="utf-8"
    )
    printed = said(capsys, "my_log.csv", "--set", "entities=my_kinds.csv")
    assert {"my_log.csv:", "  kitchen_item: 1", "  room_1: 1", "unique triples: 1"} <= set(
        printed.splitlines()
    )


STREAMS = {
    "-": "cat log.csv | isi graph -",
    "gzip": "gzip -c log.csv | isi graph --reader table -",
    "substitution": "isi graph --reader table <(cat log.csv)",
    "redirection": "isi graph - < log.csv",
}


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = command.replace("isi ", f"{shlex.quote(sys.executable)} -m isi ")
    return subprocess.run(
        ["/bin/bash", "-c", command],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize("stream", STREAMS)
def test_standard_input_and_substitutions_are_files(folder: Path, stream: str) -> None:
    done = run(STREAMS[stream], folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "unique triples: 6" in done.stdout


def test_a_stream_of_another_format_needs_a_reader(folder: Path) -> None:
    home = '{"rooms": [{"name": "kitchen", "objects": ["mug"]}]}'
    done = run(f"echo '{home}' | isi graph -", folder)
    assert done.returncode == 1
    assert re.fullmatch("isi graph: .*guessed reader: table; --reader .*\\n", done.stderr)
    assert run(f"echo '{home}' | isi graph --reader rooms -", folder).returncode == 0
    triple = "<urn:x:mug> <urn:x:at> <urn:x:kitchen> ."
    assert run(f"echo '{triple}' | isi graph --reader rdf -", folder).returncode == 0


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_closed_descriptors_are_no_errors(folder: Path, closed: str) -> None:
    done = run(f"isi graph log.csv --out made {closed}", folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert (folder / "made/triples.csv").exists()
    refused = run(f"isi graph none.csv {closed}", folder)
    assert refused.returncode == 1
    assert refused.stderr.count("\n") == (0 if "2>&-" in closed else 1)


def test_no_file_takes_the_number_of_a_closed_descriptor(folder: Path) -> None:
    code = (
        "import isi.process as p, os, sys\n"
        "with p.errors_in_one_line('x'): file = open('log.csv'); "
        "os.write(2 if sys.argv[1] == '1' else 1, b'%d' % file.fileno())"
    )
    for number in range(3):
        program = f"{shlex.quote(sys.executable)} -c {shlex.quote(code)} {number} {number}>&-"
        done = run(program, folder)
        assert int(done.stderr + done.stdout) > 2
