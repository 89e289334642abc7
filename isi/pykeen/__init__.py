"""New entities for a model that PyKEEN has trained: ``isi.pykeen.insert(model, factory, triples)``.

PyKEEN is an extra (``pip install '.[pykeen]'`` in the folder of isi), and imported by this package alone.
"""

from __future__ import annotations

from importlib.util import find_spec

if find_spec("pykeen") is None:
    raise ImportError("isi.pykeen needs PyKEEN: pip install pykeen")

from isi.pykeen.insert_into import enlarge, insert, inserted, warm

__all__ = ["enlarge", "insert", "inserted", "warm"]
