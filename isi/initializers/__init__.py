"""Initializers of novel entities: modules here register them under the names in ``params.yaml``."""
