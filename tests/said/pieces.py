"""What messages are made of: the constant texts of whatever the code raises to tell a user of a mistake."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

#: What tells a user of a mistake.
TOLD = {"InputError", "NotFinite", "ValueError", "ArgumentTypeError", "exit"}
#: Of a piece that is looked for, the fewest characters: shorter ones are names, places and glue.
FEWEST = 13
#: Pieces that the documentation lacks, and why.
EXCEPT = {"numbers after": "isi/report/drawing.py: of paths that Matplotlib has drawn, which no user gives"}


def pieces(path: Path) -> Iterator[str]:
    """The pieces of messages that a module raises; names stand for what their function or module puts into them."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    of_module = _assigned(node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign))
    functions = [node for top in tree.body for node in _functions(top)]
    for scope in [*functions, *(node for node in tree.body if not _functions(node))]:
        names = of_module | _assigned(ast.walk(scope))
        for node in ast.walk(scope):
            if isinstance(node, ast.Call) and _name(node.func) in TOLD:
                for argument in node.args:
                    yield from _texts(argument, names, 3)


def long_pieces(path: Path) -> list[str]:
    """Those of a module that are looked for, in one line."""
    found = (" ".join(piece.split()) for piece in pieces(path))
    return list(dict.fromkeys(piece for piece in found if len(piece) >= FEWEST))


def _functions(node: ast.AST) -> list[ast.AST]:
    """A function, or those of a class."""
    if isinstance(node, ast.ClassDef):
        return [one for child in node.body for one in _functions(child)]
    return [node] if isinstance(node, ast.FunctionDef) else []


def _name(called: ast.expr) -> str:
    return called.attr if isinstance(called, ast.Attribute) else called.id if isinstance(called, ast.Name) else ""


def _assigned(nodes: Iterator[ast.AST]) -> dict[str, list[ast.expr]]:
    """What is put into names, by name."""
    found: dict[str, list[ast.expr]] = {}
    for node in nodes:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        value = getattr(node, "value", None)
        for target in targets:
            if isinstance(target, ast.Name) and isinstance(value, ast.expr):
                found.setdefault(target.id, []).append(value)
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                for one, own in zip(target.elts, value.elts, strict=False):
                    if isinstance(one, ast.Name):
                        found.setdefault(one.id, []).append(own)
    return found


def _texts(node: ast.expr, names: dict[str, list[ast.expr]], depth: int) -> Iterator[str]:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.Name) and depth:
        for value in names.get(node.id, []):
            yield from _texts(value, names, depth - 1)
    else:
        for part in _parts(node):
            yield from _texts(part, names, depth)


def _parts(node: ast.expr) -> list[ast.expr]:
    """Of which a text is put together."""
    if isinstance(node, ast.JoinedStr):
        return node.values
    if isinstance(node, ast.FormattedValue | ast.NamedExpr | ast.Await):
        return [node.value]
    if isinstance(node, ast.IfExp):
        return [node.body, node.orelse]
    if isinstance(node, ast.BinOp):
        return [node.left, node.right]
    return node.values if isinstance(node, ast.BoolOp) else []
