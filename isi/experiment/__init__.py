"""The grid of insertions: sizes, seeds and sessions, and the tasks that run over it."""
