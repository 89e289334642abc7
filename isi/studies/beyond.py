"""All params of the second pipeline."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from isi.base import paths
from isi.base.params import Name, Section, check, read
from isi.studies.elsewhere import Elsewhere
from isi.studies.hidden import Hidden
from isi.studies.variants import Variant


class Beyond(Section):
    """The params of the second pipeline, of every stage."""

    graphs: Annotated[dict[Name, Elsewhere], Field(default_factory=dict)]
    hidden: Annotated[dict[Name, Hidden], Field(default_factory=dict)]
    variants: dict[Name, Variant]


def load(path: Path = paths.BEYOND_PARAMS) -> Beyond:
    """All params of the second pipeline; empty where there is none.

    Raises:
        InputError: where a key is unknown, of another type or out of range.
    """
    return check(read(path) if path.exists() else {"variants": {}}, Beyond, "", path)
