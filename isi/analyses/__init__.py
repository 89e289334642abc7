"""Analyses of the runs of the main grid, and further experiments."""
