"""Embeddings that others have trained, as folders: tensors and names from the files that their tools write."""
