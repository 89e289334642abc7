"""Sources of observations: one module each."""
