"""What is open at one place: a package whose modules register things by name, such as initializers."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Generic, TypeVar

from isi.errors import InputError, meant, short
from isi.tables import paths

T = TypeVar("T")


class Plugins(Generic[T]):
    """The registered things of one package, by name.

    A module of the thing's own name is tried first; then all modules of the package are imported.
    """

    def __init__(self, package: str) -> None:
        self.package = package
        self._registered: dict[str, T] = {}

    def register(self, name: str, thing: T) -> None:
        self._registered[name] = thing

    def get(self, name: str, key: str) -> T:
        """The thing of a name, or an ``InputError`` at the key of params that names it."""
        if name not in self._registered:
            if name in self._modules():
                importlib.import_module(f"{self.package}.{name}")
            if name not in self._registered and name not in self.names():
                expected = f"expected one of {', '.join(self.names())}, got {short(name)}{meant(name, self.names())}"
                raise InputError(paths.PARAMS, key, expected)
        return self._registered[name]

    def names(self) -> list[str]:
        """Names of all that the package's modules register, and of what was registered from elsewhere."""
        for module in self._modules():
            importlib.import_module(f"{self.package}.{module}")
        return sorted(self._registered)

    def _modules(self) -> list[str]:
        modules = pkgutil.iter_modules(importlib.import_module(self.package).__path__)
        return [module.name for module in modules if not module.name.startswith("_")]
