"""An embedding as a folder: what it is, its tensors, its names and its triples, in formats that any tool reads."""
