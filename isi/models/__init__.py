"""Knowledge-graph embedding models: scoring functions over stacks of tables."""
