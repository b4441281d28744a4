"""Pictures of a wall of which one half was mapped beside the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tools.evaluate.urg.cloud import Cloud
from tools.evaluate.urg.double_pictures import draw_double
from tools.evaluate.urg.walls import find_walls


def test_both_copies_of_a_double_wall_are_drawn_the_earlier_blue_the_later_red(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    x = rng.uniform(0.0, 2.0, 4000)
    scan = rng.integers(0, 40, len(x))
    y = np.where(scan < 20, 0.0, -0.2) + rng.normal(0.0, 0.005, len(x))
    cloud = Cloud(
        np.column_stack((x, y)), np.tile([0.0, 1.0], (len(x), 1)), scan, np.tile([1.0, 2.0], (len(x), 1))
    )  # fmt: skip
    (wall,) = find_walls(cloud)
    ((low_m, high_m),) = wall.double_spans_m
    assert high_m - low_m == pytest.approx(wall.double_m)
    draw_double(cloud, wall.line, (low_m, high_m), tmp_path / "double.png", title="double")
    left = np.asarray(Image.open(tmp_path / "double.png").convert("RGB")).astype(int)[60:, 64:700]
    rows = np.arange(left.shape[0])[:, None] * np.ones(left.shape[1])
    red = (left[..., 0] > 150) & (left[..., 2] < 80)
    blue = (left[..., 2] > 150) & (left[..., 0] < 80)
    assert np.count_nonzero(red) > 500
    assert np.count_nonzero(blue) > 500
    assert np.median(rows[red]) > np.median(rows[blue]) + 50  # the later copy is 0.2 m below
