"""The report: tables, figures, headline metrics and one page."""
