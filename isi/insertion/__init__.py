"""New entities in any trained embedding: ``isi.insert``."""
