"""A trained embedding as a folder: imported, queried, explained, and inserted into."""
