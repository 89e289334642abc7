"""Fuzz tests of readers: each slightly changed file gives a valid table,
or is refused in one line.
"""
