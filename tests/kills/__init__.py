"""Runs of the pipeline that are killed at random, or find no room, and are gone on with: nothing may be lost by it."""
