"""Packages that are open: a module for each name, imported when it is asked for and not before."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from isi.errors import InputError
from isi.initializers.api import INITIALIZERS
from isi.models.model import MODELS
from isi.registry import Plugins


@pytest.fixture
def dishes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Plugins[str]:
    """A package of dishes: soup, stew, and one that bears another name than its file."""
    name = f"dishes_{abs(hash(request.node.name))}"  # modules stay imported
    package = tmp_path / name
    package.mkdir()
    (package / "__init__.py").write_text(
        f"from isi.registry import Plugins\nDISHES = Plugins({name!r})\n", encoding="utf-8"
    )
    for module, registered in (("soup", "soup"), ("stew", "stew"), ("salad", "slaad"), ("_shared", "shared")):
        text = f"from {name} import DISHES\nDISHES.register({registered!r}, 'a {registered}')\n"
        (package / f"{module}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    found: Plugins[str] = __import__(name).DISHES
    return found


def imported(dishes: Plugins[str]) -> set[str]:
    prefix = f"{dishes.package}."
    return {name.removeprefix(prefix) for name in sys.modules if name.startswith(prefix)}


def test_a_plugin_is_imported_when_it_is_asked_for_and_no_other_with_it(dishes: Plugins[str]) -> None:
    assert imported(dishes) == set()
    assert dishes.names() == ["salad", "soup", "stew"]  # not what they share
    assert imported(dishes) == set()
    assert dishes.get("soup", "menu.first") == "a soup"
    assert imported(dishes) == {"soup"}


@pytest.mark.parametrize("name", ["sop", "_shared", "__init__", "soup.hot", "sys", ""])
def test_an_unknown_name_is_refused_with_those_that_are_known(dishes: Plugins[str], name: str) -> None:
    with pytest.raises(InputError) as refused:
        dishes.get(name, "menu.first")
    meant = "; did you mean 'soup'?" if name in ("sop", "soup.hot") else ""
    assert str(refused.value) == f"params.yaml: menu.first: expected one of salad, soup, stew, got {name!r}{meant}"
    assert imported(dishes) == set()


def test_a_module_that_registers_another_name_is_refused(dishes: Plugins[str]) -> None:
    with pytest.raises(InputError, match=r"^dishes_\d+/salad\.py: expected it to register 'salad'"):
        dishes.get("salad", "menu.first")


def test_what_is_registered_from_elsewhere_is_there_too(dishes: Plugins[str]) -> None:
    dishes.register("toast", "a toast")
    assert dishes.get("toast", "menu.first") == "a toast"
    assert dishes.names() == ["salad", "soup", "stew", "toast"]


@pytest.mark.parametrize("plugins", [MODELS, INITIALIZERS], ids=lambda plugins: plugins.package)
def test_every_module_that_ships_registers_its_own_name(plugins: Plugins[object]) -> None:
    modules = {path.stem for path in Path(*plugins.package.split(".")).glob("[!_]*.py")}
    assert modules <= set(plugins.names())
    for name in modules:
        assert plugins.get(name, "somewhere") is not None
