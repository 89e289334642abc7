"""Named checks of a user's own models and initializers, on a small random graph."""
