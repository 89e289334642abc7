"""RoboTHOR's 75 apartments, each of which is one room, "apartment", mined as AI2-THOR's floor plans are."""

from __future__ import annotations

from isi.sources import source
from isi.sources._household import household
from isi.sources._mining import of_recordings
from isi.sources._recording import ROBOTHOR

robothor = source("robothor", entities=household)(of_recordings("robothor", ROBOTHOR))
