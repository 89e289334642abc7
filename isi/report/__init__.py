"""The report: what was found, as tables, figures, headline metrics and one page."""
