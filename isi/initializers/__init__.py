"""Initializers of novel entities, one module each, under the name that ``params.yaml`` uses.

To add one, put it into a module of its name here and its name, with its options, under
``initializers`` of ``params.yaml``.
"""

from isi.insertion.registry import INITIALIZERS, Registered, initializer, options_of

__all__ = ["INITIALIZERS", "Registered", "initializer", "options_of"]
