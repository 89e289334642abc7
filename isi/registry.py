"""What is open at one place: a package whose modules register things by name, such as initializers."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Generic, TypeVar

from isi.errors import InputError, meant, short
from isi.tables import paths

T = TypeVar("T")


class Plugins(Generic[T]):
    """The registered things of one package, by name; its modules are imported where a name is not yet there."""

    def __init__(self, package: str) -> None:
        self.package = package
        self._registered: dict[str, T] = {}

    def register(self, name: str, thing: T) -> None:
        self._registered[name] = thing

    def get(self, name: str, key: str) -> T:
        """The thing of a name, or an ``InputError`` at the key of params that names it."""
        if name not in self._registered and name not in (known := self.names()):
            expected = f"expected one of {', '.join(known)}, got {short(name)}{meant(name, known)}"
            raise InputError(paths.PARAMS, key, expected)
        return self._registered[name]

    def names(self) -> list[str]:
        """Names of all that the package's modules register, and of what other modules have registered."""
        for module in pkgutil.iter_modules(importlib.import_module(self.package).__path__, f"{self.package}."):
            if not module.name.rpartition(".")[2].startswith("_"):
                importlib.import_module(module.name)
        return sorted(self._registered)
