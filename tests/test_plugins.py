"""Plug-in packages: a name finds the object that a module of the package registers."""

import sys
from pathlib import Path

import pytest

from isi.config import Plugins
from isi.errors import InputError

ROOT = Path(__file__).parent.parent


@pytest.fixture
def dishes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Plugins[str]:
    """A package of dishes: one module with soup, one with two dishes,
    and a private module that they share.
    """
    name = f"dishes_{abs(hash(request.node.name))}"  # modules stay imported
    package = tmp_path / name
    package.mkdir()
    (package / "__init__.py").write_text(
        f"from isi.config import Plugins\nDISHES = Plugins({name!r})\n", encoding="utf-8"
    )
    for module, registered in (
        ("soup", ["soup"]),
        ("mains", ["stew", "roast"]),
        ("_shared", ["shared"]),
    ):
        lines = [
            f"from {name} import DISHES",
            *(f"DISHES.register({dish!r}, 'a {dish}')" for dish in registered),
        ]
        (package / f"{module}.py").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    plugins: Plugins[str] = __import__(name).DISHES
    return plugins


def test_names_are_those_that_modules_or_users_register_and_not_what_modules_share(
    dishes: Plugins[str],
) -> None:
    assert dishes.names() == ["roast", "soup", "stew"]
    dishes.register("toast", "a toast")
    assert dishes.names() == ["roast", "soup", "stew", "toast"]
    assert (dishes.get("stew", "menu.first"), dishes.get("toast", "menu.first")) == (
        "a stew",
        "a toast",
    )


def test_a_name_that_no_module_registers_is_refused_with_those_that_are_known(
    dishes: Plugins[str],
) -> None:
    for name in ("sop", "_shared", "__init__", "soup.hot", "sys", "mains", ""):
        with pytest.raises(InputError) as refused:
            dishes.get(name, "menu.first")
        line = str(refused.value)
        assert all(
            part in line for part in ("params.yaml", "menu.first", "roast, soup, stew", repr(name))
        )
    assert f"{dishes.package}._shared" not in sys.modules
    with pytest.raises(InputError, match="did you mean 'soup'"):
        dishes.get("sop", "menu.first")


def test_a_name_of_another_definition_is_refused_and_the_same_one_may_come_again() -> None:
    plugins = Plugins[object]("dishes")

    def soup() -> None:
        """One soup."""

    plugins.register("soup", soup)
    plugins.register("soup", soup)
    with pytest.raises(InputError) as refused:
        plugins.register("soup", InputError)
    line = str(refused.value)
    assert all(part in line for part in ("dishes", "'soup'", soup.__module__, "isi.errors"))
    assert plugins._registered == {"soup": soup}
