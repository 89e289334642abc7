"""Inserting novel entities into a trained embedding."""
