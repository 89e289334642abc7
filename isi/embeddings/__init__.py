"""Multi-relational embeddings, as stacks of M models that train and score together."""
