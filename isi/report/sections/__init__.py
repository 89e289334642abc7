"""The sections of the page; ``isi/report/templates/pages.yaml`` has their order."""
