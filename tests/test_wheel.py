"""The distribution: what it contains, and that it works where only the packages
that it needs are installed.

The wheel is built from the source distribution and installed into an empty environment. Its
dependencies are linked from the environment of the tests, so no network is needed, and what the
wheel does not declare is absent.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import venv
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from packaging.metadata import Metadata
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.documented import DOCS, blocks
from tests.imports import HEAVY
from tests.small_bundle import home_of

ROOT = DOCS.parent
#: Maximum number of distributions in an environment with the wheel alone; those that a CUDA build
#: of torch adds.
MOST, CUDA = 40, ("cuda-", "nvidia-", "triton")
BUILD = (
    "import sys; from setuptools import build_meta; print(getattr(build_meta, "
    "sys.argv[1])(sys.argv[2]))"
)


@dataclass(frozen=True)
class Built:
    """The two files that ``make wheel`` builds."""

    source: Path
    wheel: Path


@dataclass(frozen=True)
class Empty:
    """An environment of the wheel and the distributions that it needs."""

    folder: Path
    distributions: set[str]

    def run(self, *command: str, status: int = 0) -> str:
        """What a command of the environment prints, run in an empty folder."""
        program, *rest = command
        settings = {
            "PATH": os.environ["PATH"],
            "PYTHONDONTWRITEBYTECODE": "1",
            "OMP_NUM_THREADS": "1",
        }
        done = subprocess.run(
            [self.folder / "bin" / program, *rest],
            cwd=self.folder,
            env=settings,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == status, done.stderr
        return done.stdout + done.stderr


def build(form: str, folder: Path, out: Path) -> Path:
    """Build a distribution of a folder with the installed setuptools."""
    built = subprocess.run(
        [sys.executable, "-c", BUILD, f"build_{form}", out],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return out / built.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    tree, out = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("dist")
    for path in ROOT.glob("[!.]*"):
        if path.suffix != ".egg-info":
            (tree / path.name).symlink_to(path)
    source = build("sdist", tree, out)
    shutil.unpack_archive(source, out)
    (unpacked,) = (path for path in out.iterdir() if path.is_dir())
    return Built(source, build("wheel", unpacked, out))


def closure(metadata: Metadata) -> Iterator[Distribution]:
    """The distributions that the metadata requires without extras, directly and indirectly."""
    waiting, seen = list(metadata.requires_dist or ()), set[str]()
    while waiting:
        wanted = waiting.pop()
        if canonicalize_name(wanted.name) not in seen and (
            not wanted.marker or wanted.marker.evaluate({"extra": ""})
        ):
            seen.add(canonicalize_name(wanted.name))
            yield (installed := distribution(wanted.name))
            waiting += map(Requirement, installed.requires or ())


@pytest.fixture(scope="module")
def empty(built: Built, tmp_path_factory: pytest.TempPathFactory) -> Empty:
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True)
    (packages,) = folder.glob("lib/*/site-packages")
    needed = list(closure(metadata_of(built.wheel)))
    for part in needed:
        for name in {
            file.parts[0] for file in part.files or () if file.parts[0] not in ("..", "__pycache__")
        }:
            if not (packages / name).exists():
                (packages / name).symlink_to(part.locate_file(name))
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        folder / "bin" / "python",
        "install",
        "--quiet",
        "--no-deps",
    ]
    subprocess.run([*pip, "--no-index", built.wheel], check=True)
    return Empty(folder, {canonicalize_name(part.name) for part in needed} | {"isi-kge"})


def metadata_of(wheel: Path) -> Metadata:
    """The metadata of a wheel; raises an exception where a field breaks its specification."""
    with ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return Metadata.from_email(archive.read(name))


def test_the_wheel_contains_the_library_alone(built: Built) -> None:
    with ZipFile(built.wheel) as archive:
        files = {Path(name) for name in archive.namelist()}
    assert {path.parts[0] for path in files} == {
        "isi",
        f"{'-'.join(built.wheel.name.split('-')[:2])}.dist-info",
    }
    ours = [
        path
        for path in (ROOT / "isi").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    assert {path for path in files if path.parts[0] == "isi"} == {
        path.relative_to(ROOT) for path in ours
    }
    assert {"LICENSE", "NOTICE.md"} <= {path.name for path in files}


def test_the_source_distribution_contains_the_documentation_and_no_data(built: Built) -> None:
    with tarfile.open(built.source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"LICENSE", "NOTICE.md", "README.md", "CHANGELOG.md", "docs/insert.md"} <= names
    assert not [name for name in names if name.startswith(("data", "reports", "stages", "tests"))]


def test_the_page_on_a_package_index_has_no_link_that_breaks_there(built: Built) -> None:
    metadata = metadata_of(built.wheel)
    assert (metadata.name, metadata.description_content_type) == ("isi-kge", "text/markdown")
    assert "isi.insert" in (metadata.description or "")
    assert metadata.description.count("](") == metadata.description.count("](https://") > 0


def test_extras_that_messages_and_pages_name_exist(built: Built) -> None:
    code = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "isi").rglob("*.py"))
    pages = "".join(path.read_text(encoding="utf-8") for path in DOCS.glob("*.md"))
    listed = {
        extra
        for text in re.findall(r"""(?:isi-kge|["']\.)\[([a-z,-]+)\]""", code + pages)
        for extra in text.split(",")
    }
    extras = listed | set(re.findall(r"\bextra\(\"(.*?)\"\)", code))
    assert (
        {"pipeline", "pykeen", "words"}
        <= extras
        <= set(metadata_of(built.wheel).provides_extra or ())
    )


def test_the_environment_is_small_and_the_rest_is_absent(empty: Empty) -> None:
    assert len([name for name in empty.distributions if not name.startswith(CUDA)]) <= MOST
    assert empty.distributions.isdisjoint(HEAVY)
    find = (
        "from importlib.util import find_spec; print([name for name "
        f"in {HEAVY} if find_spec(name)])"
    )
    assert empty.run("python", "-c", find).strip() == "[]"


def test_an_import_of_isi_loads_nothing_else(empty: Empty) -> None:
    code = "import sys; before = {*sys.modules}; import isi; print(*{*sys.modules} - before)"
    loaded = {name.partition(".")[0] for name in empty.run("python", "-c", code).split()}
    assert loaded - sys.stdlib_module_names == {"isi"}


def test_insertion_works_in_the_empty_environment(empty: Empty) -> None:
    code = blocks("insert.md", "python")[0]
    assert "fold_in" in empty.run("python", "-c", code)


def test_commands_work_in_the_empty_environment(empty: Empty, tmp_path: Path) -> None:
    home = ("--home", str(home_of(tmp_path / "home")))
    facts = ("toaster", "atLocation", "kitchen", "toaster", "hasAffordance", "turn on")
    empty.run("isi", "tell", *facts, *home)
    asked = empty.run("isi", "ask", "toaster", "atLocation", *home, "--json")
    assert json.loads(asked)["answers"][0]["entity"] == "kitchen"
    assert "toaster hasAffordance turn on" in empty.run("isi", "explain", "toaster", *home)


def test_an_import_works_in_the_empty_environment(empty: Empty, tmp_path: Path) -> None:
    (tmp_path / "entities.txt").write_text("mug\nkitchen\n")
    (tmp_path / "relations.txt").write_text("in\n")
    (tmp_path / "triples.tsv").write_text("mug\tin\tkitchen\n")
    tables = {"entities": np.array([[1.0, 2], [3, 4]]), "relations": np.array([[1.0, 1]])}
    np.savez(tmp_path / "model.npz", **tables)
    options = ("--model", "distmult", "--out", str(tmp_path / "bundle"))
    assert "2 entities, 1 relations, 1 triples" in empty.run(
        "isi", "import", str(tmp_path), *options
    )


@pytest.mark.parametrize(
    ("extra", "command"),
    [
        ("pykeen", ["python", "-c", "import isi; isi.pykeen"]),
        ("rdf", ["isi", "train", "triples.ttl", "--out", "home"]),
        (
            "words-file",
            ["isi", "train", "triples.csv", "--vectors", "words.txt", "--out", "home"],
        ),
        ("pipeline", ["isi", "train", "triples.parquet", "--describe"]),
    ],
)
def test_the_extra_of_a_missing_package_is_named(
    empty: Empty, extra: str, command: list[str]
) -> None:
    shutil.copy(ROOT / "params.yaml", empty.folder)
    triples = "head,relation,tail\nmug,at,kitchen\ncup,at,kitchen\n"
    (empty.folder / "triples.csv").write_text(triples, encoding="utf-8")
    (empty.folder / "triples.parquet").write_bytes(b"PAR1")
    (empty.folder / "triples.ttl").write_text(
        "<urn:mug> <urn:at> <urn:kitchen> .", encoding="utf-8"
    )
    line = empty.run(*command, status=1).splitlines()[-1]
    assert line.endswith(f"not installed: pip install 'isi-kge[{extra}]'")
