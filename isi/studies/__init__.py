"""Studies beside the main experiment, each of one experiment of params."""
