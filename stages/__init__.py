"""The stages of the pipeline: each reads, calls isi, and writes."""
