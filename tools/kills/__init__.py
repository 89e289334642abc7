"""Runs of the pipeline that are killed at random, or find no disk space,
and are continued without loss.
"""
