"""Batches, gradients, training, ranks and scopes, for stacks of models of any family."""
