"""Incremental semantic initialization (ISI) of entities in knowledge-graph embeddings."""
