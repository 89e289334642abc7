"""All mistakes, by what a file is read as."""

from __future__ import annotations

from tests.said.listed import BEHAVIOR_CASES, ID_CASES, MP3D_CASES, RDF_CASES, SHIPPED_CASES, TABLE_CASES, WORD_CASES
from tests.said.scenes import HOUSE_CASES, RECORDING_CASES, SCENE_CASES

CASES = {
    "scene of AI2-THOR": SCENE_CASES,
    "recording": RECORDING_CASES,
    "house of ProcTHOR": HOUSE_CASES,
    "table": TABLE_CASES,
    "RDF": RDF_CASES,
    "Matterport3D": MP3D_CASES,
    "table that ships": SHIPPED_CASES,
    "triples with ids": ID_CASES,
    "BEHAVIOR": BEHAVIOR_CASES,
    "word vectors": WORD_CASES,
}
