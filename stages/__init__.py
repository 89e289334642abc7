"""The stages of the pipeline: each reads, calls isi, and writes.

Importing the package, which running a stage does first of all, ties the process to the one that
started it: DVC leaves its stage running when it is killed.
"""

from isi.lifetime import tie_to_parent

tie_to_parent()
