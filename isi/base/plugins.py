"""What is open at one place: a package of modules, each of which registers one thing under its own name."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Generic, TypeVar

from isi.base import paths
from isi.base.errors import InputError, meant, short

T = TypeVar("T")


class Plugins(Generic[T]):
    """The things of one package, by name. A module is imported when it is asked for, and no other with it."""

    def __init__(self, package: str) -> None:
        self.package = package
        self._registered: dict[str, T] = {}

    def register(self, name: str, thing: T) -> None:
        self._registered[name] = thing

    def get(self, name: str, key: str) -> T:
        """The thing of a name.

        Raises:
            InputError: where no module has it; ``key`` is where params name it.
        """
        if name not in self._registered:
            if name not in self.names():
                expected = f"expected one of {', '.join(self.names())}, got {short(name)}{meant(name, self.names())}"
                raise InputError(paths.PARAMS, key, expected)
            importlib.import_module(f"{self.package}.{name}")
            if name not in self._registered:
                where = f"{self.package.replace('.', '/')}/{name}.py"
                raise InputError(where, "", f"expected it to register {name!r}, the name of its file")
        return self._registered[name]

    def names(self) -> list[str]:
        """Names of the package's modules, and of what was registered from elsewhere."""
        modules = pkgutil.iter_modules(importlib.import_module(self.package).__path__)
        return sorted({module.name for module in modules if not module.name.startswith("_")} | set(self._registered))
