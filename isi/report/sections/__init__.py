"""The sections of the page, one module each; ``contents`` has their order."""
