"""The tables of the report, made from the pipelines' outputs and written as CSV, Markdown and
LaTeX. The pages are drawn from these files alone.
"""
