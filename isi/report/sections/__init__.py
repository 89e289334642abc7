"""The sections of the page; ``CONTENTS`` in ``isi/report/page.py`` has their order."""
