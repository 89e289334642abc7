"""New entities in any trained embedding: ``isi.insert`` and ``isi.fit_new``."""
