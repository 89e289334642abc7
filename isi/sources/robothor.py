"""RoboTHOR's scenes as the simulator reported them, mined as AI2-THOR's are."""

from __future__ import annotations

from collections.abc import Iterator

import pyarrow as pa

from isi.base.params import Sha256
from isi.sources import Mining, source
from isi.sources._household import household
from isi.sources._mining import Broken, Circular, Materials, Untidy, materials_of, mine
from isi.sources._recording import ROBOTHOR, locate, read_recording


@source("robothor", entities=household)
def robothor(
    mining: Mining,
    from_: str,
    sha256: Sha256 | None,
    materials: Materials,
    broken: Broken,
    circular: Circular = "keep",
) -> Iterator[pa.Table]:
    """Observations of the recorded apartments, each of which is one room, "apartment".

    Args:
        mining: its seed draws materials; counts what is dropped.
        from_: ``recording``, the 75 in the package ``procthor``; ``simulator``, those of ``make record``; or the path
            of a file of either form.
        sha256: what the file must hash to, if it is to be checked.
        materials: drawn as in SUNCG, or as the simulator reports them.
        broken: what becomes of a receptacle that its scene lacks, and of contents that are not there or elsewhere.
        circular: what becomes of a receptacle that lies in what it holds.
    """
    path = locate(from_, "robothor")
    scenes = read_recording(path, sha256, ROBOTHOR)
    return mine(scenes, materials_of(materials, mining.seed), path, Untidy(broken, circular, mining.left))
