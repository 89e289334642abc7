"""JSON as readers read it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from isi.errors import InputError


def json_of(path: Path, place: str, content: bytes | str) -> Any:
    """What JSON holds, of UTF-8 with a byte order mark or without.

    Raises:
        InputError: where it is broken, too deep for Python, or has a number that is too long for it.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(path, place, f"expected JSON: {error}") from error
    except UnicodeDecodeError as error:
        raise InputError(path, place, f"expected JSON: no UTF-8 ({error})") from error
    except RecursionError as error:
        raise InputError(path, place, "expected JSON: lists and mappings are too deep in each other") from error
    except ValueError as error:
        raise InputError(path, place, "expected JSON: a number has more than 4,300 digits") from error
