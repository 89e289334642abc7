"""Ranks and MRR* of trained embeddings."""
