"""The command ``isi``."""
