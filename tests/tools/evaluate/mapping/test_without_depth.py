from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from station_gui.build import build_pipeline
from station_gui.config import load_config
from station_gui.mapping.snapshot import ObjectKind
from tools.logs.urg import UrgReader

LOG = Path(__file__).resolve().parents[5] / "shared" / "data" / "urg04lx" / "exp1.dat.gz"


@pytest.mark.skipif(not LOG.is_file(), reason=f"the recorded data is not at {LOG}")
def test_a_recording_without_depth_has_walls_only_and_they_stand_where_the_grid_is_occupied() -> None:
    pipeline = build_pipeline(load_config(None))
    for observation in itertools.islice(UrgReader(LOG), 200):
        pipeline.add(observation)
    pipeline.finish()
    snapshot = pipeline.snapshot()
    panels = snapshot.objects.panels
    assert len(snapshot.objects.segments_m) == 0
    assert len(panels.kind) >= 10
    assert set(panels.kind.tolist()) == {ObjectKind.FLAT}
    assert np.isfinite(panels.corners_m).all()
    middles_m = panels.corners_m[:, :, :2].mean(axis=1)
    cells_m = snapshot.grid.occupied_m()
    off_m = [np.hypot(*(cells_m - middle).T).min() for middle in middles_m]
    assert max(off_m) < 0.15
