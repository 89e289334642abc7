"""The grid: which cells, with which seeds, as tasks that run on worker processes."""
