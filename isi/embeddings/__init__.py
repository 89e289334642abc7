"""Stacks of knowledge-graph embeddings, and what a family of them is made of."""
