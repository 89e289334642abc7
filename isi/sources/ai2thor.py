"""AI2-THOR: the 120 floor plans of iTHOR as the simulator reported them, mined into observations (section 5.1)."""

from __future__ import annotations

from isi.sources import source
from isi.sources._household import household
from isi.sources._mining import of_recordings
from isi.sources._recording import ITHOR

ai2thor = source("ai2thor", entities=household)(of_recordings("ai2thor", ITHOR))
