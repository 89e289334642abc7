"""Settings as a command line gives them: ``KEY=VALUE``."""

from __future__ import annotations

import argparse
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from isi.errors import short


def setting(text: str) -> tuple[str, Any]:
    """Key and value of ``KEY=VALUE``, the value in YAML."""
    key, found, value = text.partition("=")
    try:
        return key, YAML(typ="safe", pure=True).load(value if found and key else "]")
    except (YAMLError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:  # of a value's tag
        raise argparse.ArgumentTypeError(f"expected KEY=VALUE, the value in YAML, got {short(text)}") from error
