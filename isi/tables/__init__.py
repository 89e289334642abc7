"""The tables and tensors of the pipeline: paths, columns, rules,
checked reads and atomic writes.
"""
