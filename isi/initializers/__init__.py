"""Initializers of novel entities, registered under the names that ``params.yaml`` uses.

To add one, register a function in a module here and list its name, with its options, under ``initializers`` of
``params.yaml``.
"""
