"""The sections of the page; ``isi/report/templates/sections.yaml`` has their order."""
