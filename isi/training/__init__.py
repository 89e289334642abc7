"""Batches, negatives and the training loop, for stacks of models."""
