"""New entities for anyone's trained embedding: ``isi.insert`` and ``isi.fit_new``."""
