"""What is measured beside the main grid of insertions."""
