"""AI2-THOR scenes as the simulator reported them, mined into observations (section 5.1)."""

from __future__ import annotations

from collections.abc import Iterator

import pyarrow as pa

from isi.base.params import Sha256
from isi.sources import Mining, source
from isi.sources._household import household
from isi.sources._mining import Broken, Circular, Materials, Untidy, materials_of, mine
from isi.sources._recording import ITHOR, locate, read_recording


@source("ai2thor", entities=household)
def ai2thor(
    mining: Mining,
    from_: str,
    sha256: Sha256 | None,
    materials: Materials,
    broken: Broken,
    circular: Circular = "keep",
) -> Iterator[pa.Table]:
    """Observations of the recorded floor plans of iTHOR.

    Args:
        mining: its seed draws materials; counts what is dropped.
        from_: ``recording``, the one in the package ``procthor``; ``simulator``, the one of ``make record``; or the
            path of a file of either form.
        sha256: what the file must hash to, if it is to be checked.
        materials: drawn as in SUNCG, or as the simulator reports them.
        broken: what becomes of a receptacle that its scene lacks, and of contents that are not there or elsewhere.
        circular: what becomes of a receptacle that lies in what it holds. The package's recording has fourteen such
            observations: cabinets that overlap, and a counter top that lies in the plate on it.
    """
    path = locate(from_)
    scenes = read_recording(path, sha256, ITHOR)
    return mine(scenes, materials_of(materials, mining.seed), path, Untidy(broken, circular, mining.left))
