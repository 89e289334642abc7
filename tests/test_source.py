"""Nothing in the source runs what it reads: no pickle, no eval, no shell."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILES = sorted(path for folder in ("isi", "stages", "tools") for path in (ROOT / folder).rglob("*.py"))
#: Modules that make objects of bytes by running what these say, or lead there.
MODULES = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "pty", "commands"}
NAMES = {"eval", "exec", "compile", "__import__", "breakpoint", "input"}
#: By the name behind the last dot, and that before it.
CALLS = {
    ("os", "system"), ("os", "popen"), ("os", "execv"), ("os", "spawnl"), ("subprocess", "getoutput"),
    ("subprocess", "getstatusoutput"), ("yaml", "load"), ("yaml", "unsafe_load"), ("yaml", "full_load"),
    ("pandas", "read_pickle"), ("pd", "read_pickle"), ("jsonpickle", "decode"), ("asyncio", "create_subprocess_shell"),
}  # fmt: skip
#: What is read by libraries with a pickle unless an option says not to.
MUST = {("torch", "load"): ("weights_only", True), ("np", "load"): ("allow_pickle", False),
        ("numpy", "load"): ("allow_pickle", False), ("YAML", ""): ("typ", "safe")}  # fmt: skip
#: File and what it holds: where the user has said by a flag that he trusts a file, or where an error alone is named.
ALLOWED = {
    ("isi/cli/import_.py", "torch.load without weights_only=True"),
    ("isi/bundle/import_tensors.py", "pickle"),
}


def called(node: ast.Call) -> tuple[str, str]:
    """Name before the last dot of what is called, and behind it."""
    function = node.func
    if isinstance(function, ast.Name):
        return function.id, ""
    if isinstance(function, ast.Attribute):
        before = function.value
        last = before.attr if isinstance(before, ast.Attribute) else before.id if isinstance(before, ast.Name) else ""
        return last, function.attr
    return "", ""


def option(node: ast.Call, name: str) -> object:
    return next((ast.literal_eval(one.value) for one in node.keywords
                 if one.arg == name and isinstance(one.value, ast.Constant)), None)  # fmt: skip


def dangers(tree: ast.AST) -> Iterator[str]:
    """What of a module runs what it reads."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.partition(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom):
            if (node.module or "").partition(".")[0] in MODULES:
                yield str(node.module)
            yield from (f"{node.module}.{one.name}" for one in node.names if (str(node.module), one.name) in CALLS)
        elif isinstance(node, ast.Call):
            yield from _of_call(node)
        elif isinstance(node, ast.Attribute) and node.attr == "__globals__":
            yield node.attr


def _of_call(node: ast.Call) -> Iterator[str]:
    what = called(node)
    if what[0] in NAMES and not what[1]:
        yield what[0]
    if what in CALLS:
        yield ".".join(what)
    if option(node, "shell") not in (None, False) or any(one.arg == "shell" and not isinstance(one.value, ast.Constant)
                                                         for one in node.keywords):  # fmt: skip
        yield "shell"
    if what in MUST:
        name, value = MUST[what]
        rewriting = what[0] == "YAML" and not node.keywords  # ruamel's round trip makes no objects
        if option(node, name) != value and not rewriting:
            yield f"{'.'.join(filter(None, what))} without {name}={value}"


def test_there_is_source_to_look_at() -> None:
    assert len(FILES) > 150


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_runs_what_it_reads(path: Path) -> None:
    name = str(path.relative_to(ROOT))
    found = dangers(ast.parse(path.read_text(encoding="utf-8")))
    assert [one for one in found if (name, one) not in ALLOWED] == []


@pytest.mark.parametrize(
    "text",
    [
        "import pickle", "from pickle import loads", "import pickle as harmless", "from os import system", "eval('1')",
        "exec(text)", "__import__('os')", "import os\nos.system('ls')", "subprocess.run('ls', shell=True)",
        "subprocess.run('ls', shell=given)", "yaml.load(text)", "torch.load(path)", "torch.load(p, weights_only=False)",
        "np.load(path)", "np.load(path, allow_pickle=True)", "pd.read_pickle(path)", "YAML(typ='unsafe')",
        "f.__globals__", "compile(text, '', 'exec')", "import dill.source",
    ],
)  # fmt: skip
def test_a_danger_would_be_found(text: str) -> None:
    assert list(dangers(ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        "re.compile(text)", "model.eval()", "torch.load(path, weights_only=True)", "YAML(typ='safe').load(text)",
        "YAML()", "subprocess.run(['ls'], shell=False)", "np.load(path, allow_pickle=False)", "json.load(file)",
    ],
)  # fmt: skip
def test_what_is_harmless_is_let_be(text: str) -> None:
    assert not list(dangers(ast.parse(text)))
