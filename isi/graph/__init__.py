"""The knowledge graph as tensors, its learning sessions, and the word vectors of its entities."""
