"""Mine AI2-THOR's recorded scenes into observations."""

from __future__ import annotations

from isi import paths, tables
from isi.scenes import ai2thor, materials
from isi.stage import Params, Provenance, stage


@stage("seed", "ai2thor.recording", "ai2thor.sha256", "materials.source")
def mine_ai2thor(params: Params, provenance: Provenance) -> None:
    """Mine AI2-THOR's recorded scenes into observations."""
    recording = ai2thor.locate(params.ai2thor.recording)
    scenes = ai2thor.read_recording(recording, params.ai2thor.sha256)
    if params.materials.source == "suncg":
        shares = materials.read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES)
        materials_of = materials.suncg(shares, params.seed)
    else:
        materials_of = materials.simulator
    mined = ai2thor.mine(scenes, materials_of, recording)
    rows = tables.write_stream(paths.observations("ai2thor"), mined, tables.OBSERVATIONS, provenance)
    print(f"{rows:,} observations in {len(scenes)} scenes")


if __name__ == "__main__":
    mine_ai2thor()
