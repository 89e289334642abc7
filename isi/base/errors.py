"""What the user did wrong, said in one line."""

from __future__ import annotations


class InputError(Exception):
    """A mistake in what the user supplied: names the file, the place in it, and what was expected."""

    def __init__(self, file: object, place: str, expected: str) -> None:
        super().__init__(str(file), place, expected)

    def __str__(self) -> str:
        return " ".join(": ".join(part for part in self.args if part).split())
