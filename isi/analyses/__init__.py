"""Analyses beside the main grid of insertions."""
