"""A trained embedding as a folder: import, queries, explanations, and insertion of entities."""
