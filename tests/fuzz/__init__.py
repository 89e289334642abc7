"""Every reader on files that are nearly what it reads: it gives a lawful table, or refuses in one line."""
