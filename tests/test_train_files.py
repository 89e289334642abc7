"""The files that ``isi train`` reads: paths, streams, what is printed, and refused input."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import isi
from isi.tables import paths
from tests.imports import HEAVY

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


#: What the packages of the core do not need.


def test_files_are_read_and_trained_on_anywhere_with_the_packages_of_the_core_alone(
    tmp_path: Path,
) -> None:
    (tmp_path / "log.csv").write_text(LOG, encoding="utf-8")
    mug = {"objectType": "Mug", "objectId": "Mug|1", "parentReceptacles": None}
    scene = [mug | {"salientMaterials": ["Ceramic"], "sliceable": True}]
    (tmp_path / "scene.json").write_text(json.dumps(scene), encoding="utf-8")
    code = f"""
import sys
sys.modules |= dict.fromkeys({HEAVY})
from isi.__main__ import main
files = ["log.csv", "kitchen=scene.json"]
main(["train", *files, "--describe"])
main(["train", *files, "--out", "home", "--dimension", "4"])
main(["ask", "mug", "atLocation"])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    # 10, and a mug's room, material and affordance
    assert "observations: 13\n" in done.stdout
    assert "kitchen (known)" in done.stdout
    with isi.open(tmp_path / "home") as home:
        assert not home.derived.choices.preparation()  # all choices are made
        kinds = dict(zip(home.base.entity_names, home.base.kinds, strict=True))
    assert (kinds["mug"], kinds["bedroom"]) == ("object", "")


# Paths


def test_bytes_that_are_no_text_are_printed_and_named_in_errors(folder: Path) -> None:
    good, bad, missing = (os.fsdecode(letter + b"\xff.csv") for letter in (b"d", b"e", b"f"))
    (folder / good).write_text(LOG, encoding="utf-8")
    (folder / bad).write_text("x\n", encoding="utf-8")
    code = """
import sys
from isi.__main__ import main
for name in sys.argv[1:]:
    try:
        main(["train", name, "--describe"])
    except SystemExit as ended:
        print(ended, file=sys.stderr)
"""
    command = [sys.executable, "-c", code, good, bad, missing]
    done = subprocess.run(command, capture_output=True, check=True, cwd=folder)
    assert b"d\\udcff" in done.stdout
    assert done.stderr.count(b"\n") == 2
    assert b"e\\udcff" in done.stderr
    assert b"f\\udcff" in done.stderr


STREAMS = {
    "-": "cat log.csv | isi train --describe -",
    "gzip": "gzip -c log.csv | isi train --describe --reader table -",
    "substitution": "isi train --describe --reader table <(cat log.csv)",
    "redirection": "isi train --describe - < log.csv",
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
    done = run(f"echo '{home}' | isi train --describe -", folder)
    assert done.returncode == 1
    assert re.fullmatch("isi train: .*read by table; --reader .*\\n", done.stderr)
    assert run(f"echo '{home}' | isi train --describe --reader rooms -", folder).returncode == 0
    triple = "<urn:x:mug> <urn:x:at> <urn:x:kitchen> ."
    assert run(f"echo '{triple}' | isi train --describe --reader rdf -", folder).returncode == 0


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_a_closed_descriptor_is_an_error_if_it_takes_output(folder: Path, closed: str) -> None:
    done = run(f"isi train log.csv --describe {closed}", folder)
    is_lost = closed.startswith(">")
    assert (done.returncode, done.stderr.count("\n")) == (is_lost, closed == ">&-")
    refused = run(f"isi train --describe none.csv {closed}", folder)
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
