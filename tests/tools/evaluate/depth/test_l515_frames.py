"""The two recorded frames of an L515, as a person would draw them; pixels are read off the pictures."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from robot_app.perception.config import PerceptionConfig
from robot_app.perception.object_extractor import ObjectExtractor
from tools.evaluate.depth.extraction import intrinsics_of, mount_of
from tools.evaluate.depth.files import read_depth

FRAMES = Path(__file__).resolve().parents[4] / ".." / "shared" / "data" / "depth" / "l515"
PARCEL_PX = [(113, 155), (357, 70), (411, 353), (303, 372), (297, 345), (160, 376), (113, 155)]

pytestmark = pytest.mark.skipif(not FRAMES.is_dir(), reason="the L515 frames (../shared/data/depth) are not here")


def along(corners_px: list[tuple[float, float]], step_px: float = 2.0) -> np.ndarray:
    pieces = []
    for a, b in pairwise(corners_px):
        count = int(np.hypot(b[0] - a[0], b[1] - a[1]) / step_px) + 2
        pieces.append(np.linspace(a, b, count))
    return np.concatenate(pieces)


def drawn_px(name: str) -> np.ndarray:
    """(P, 2): columns and rows along all connections that are drawn in a frame."""
    path = FRAMES / name
    file = read_depth(path)
    lens = intrinsics_of(path, file.image, file.lens_px)
    mount = mount_of("search", file.image, lens)
    network = ObjectExtractor(PerceptionConfig(), lens, mount).extract(file.image)
    optical_from_robot = np.linalg.inv(mount.robot_from_optical())
    points = network.nodes_m @ optical_from_robot[:3, :3].T + optical_from_robot[:3, 3]
    pixels = points[:, :2] / points[:, 2:] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    return np.concatenate([along([tuple(pixels[a]), tuple(pixels[b])]) for a, b in network.edges])


def test_the_parcel_is_drawn_all_round() -> None:
    drawn, outline = drawn_px("depth_array.npy.gz"), along(PARCEL_PX)
    off_px = np.linalg.norm(outline[:, None] - drawn, axis=2).min(axis=1)
    assert np.mean(off_px < 14.0) > 0.97


def test_hardly_a_line_is_drawn_in_the_noisy_band_at_the_top() -> None:
    drawn = drawn_px("depth_array_noalign.npy.gz")
    assert 2.0 * np.count_nonzero(drawn[:, 1] < 45) < 100.0
    assert np.mean(np.abs(drawn[:, 1] - 60.0) < 15.0) > 0.4
