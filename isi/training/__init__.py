"""Batches, negatives and the training loop, for stacks of models; and of the rows of one."""
