"""What everything stands on: errors, paths, params, random streams, tables, and what a stage does around its work."""
