"""Names in the code are the field's: no package, module, class,
function or param has one of the words below.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parent.parent
#: Words that must not be part of a name.
PARTS = {
    "asked", "asking", "chance", "chances", "crowding", "damage", "elsewhere", "families", "family",
    "followed", "kept", "keeping", "meeting", "rehearsal", "rehearsed", "stated", "steady", "told",
    "varied",
}  # fmt: skip
#: Words that must not be a whole name.
WHOLE = {
    "approach", "at_once", "cell", "cells", "drawing", "every", "found", "given", "held", "how",
    "keep", "listed", "meet", "news", "nothing", "one", "own", "placed", "rates", "some",
    "what",
}  # fmt: skip
#: Words that must not name an argument or a local, since they do not describe the value.
LOCALS = {"found", "how", "one", "own", "some", "what"}


def names(path: Path) -> Iterator[str]:
    """Names of a module, of its folder, and of its classes and functions."""
    yield from (path.stem, path.parent.name)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.name


def keys(values: object) -> Iterator[str]:
    if isinstance(values, dict):
        for key, value in values.items():
            yield str(key)
            yield from keys(value)


def unwanted(name: str) -> bool:
    plain = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().strip("_")
    return plain in WHOLE or bool(PARTS & set(plain.split("_")))


@pytest.mark.parametrize("folder", ["isi", "stages", "tools"])
def test_code_uses_the_words_of_the_field(folder: str) -> None:
    names_found = {
        f"{path}: {name}"
        for path in (ROOT / folder).rglob("*.py")
        for name in names(path)
        if unwanted(name)
    }
    assert not names_found


@pytest.mark.parametrize("folder", ["isi", "stages", "tools"])
def test_arguments_and_locals_say_what_they_hold(folder: str) -> None:
    for path in (ROOT / folder).rglob("*.py"):
        for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(function, ast.FunctionDef | ast.Lambda):
                stored = [
                    node
                    for node in ast.walk(function)
                    if isinstance(getattr(node, "ctx", None), ast.Store)
                ]
                assigned = {node.id for node in stored if isinstance(node, ast.Name)}
                arguments = {node.arg for node in ast.walk(function) if isinstance(node, ast.arg)}
                assert not (assigned | arguments) & LOCALS, path


@pytest.mark.parametrize(
    "file",
    [f"{folder}{name}.yaml" for folder in ("", "beyond/") for name in ("params", "dvc")],
)
def test_params_and_stages_use_the_words_of_the_field(file: str) -> None:
    assert not {
        key
        for key in keys(yaml.safe_load((ROOT / file).read_text(encoding="utf-8")))
        if unwanted(key)
    }


def type_names(module: ast.Module) -> Iterator[str]:
    """Names of classes, and of aliases of types at the top of a module. Type variables have one
    letter, constants only capitals.
    """
    for node in ast.walk(module):
        if isinstance(node, ast.ClassDef):
            yield node.name
    for node in module.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                if isinstance(target, ast.Name) and re.fullmatch("[A-Z]+[a-z][A-Za-z]*", target.id):
                    yield target.id


def test_no_two_classes_or_aliases_have_the_same_name() -> None:
    """A name of a type has one meaning, in the library and in the study."""
    paths = [path for folder in ("isi", "stages") for path in (ROOT / folder).rglob("*.py")]
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in paths]
    number = Counter(name for tree in trees for name in type_names(tree))
    assert not [name for name in number if number[name] > 1]


def test_no_test_imports_from_another_test() -> None:
    imports = re.compile(r"^from tests\.(?:\w+\.)*test_|^from tests import .*\btest_", re.MULTILINE)
    assert not [
        str(path)
        for path in (ROOT / "tests").rglob("*.py")
        if imports.search(path.read_text("utf-8"))
    ]
