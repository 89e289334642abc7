"""The report: tables, figures and the page, from what the runs left behind."""
