"""New entities for an embedding of anyone's, given as plain arrays."""
