from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import GraphSlamConfig
from station_gui.mapping.slam2d.graph_slam import GraphSlam

FloatArray = NDArray[np.float64]


@pytest.fixture(scope="module")
def maps() -> dict[str, SavedMap]:
    """Maps by name, so that each is made once per file."""
    return {}


@pytest.fixture
def lab_map(
    maps: dict[str, SavedMap],
    lab: FloatArray,
    lap: Callable[[int], list[Pose2]],
    scan_from: Callable[..., PointScan],
) -> SavedMap:
    """The lab after one lap; its frame is the room's."""
    if "lab" not in maps:
        rng = np.random.default_rng(0)
        slam = GraphSlam(GraphSlamConfig())
        for k, pose in enumerate(lap(80)):
            slam.add(scan_from(lab, pose, rng, stamp_s=0.1 * k))
        slam.finish()
        maps["lab"] = slam.saved()
    return maps["lab"]


def _box(x: float, y: float, width: float, height: float) -> list[tuple[float, float, float, float]]:
    a, b = x + width, y + height
    return [(x, y, a, y), (a, y, a, b), (a, b, x, b), (x, b, x, y)]


@pytest.fixture
def lab(lab: FloatArray) -> FloatArray:
    """(W, 4): the lab, with two more things that make its two halves unlike."""
    return np.vstack((lab, _box(0.0, 2.5, 0.4, 0.9), _box(3.4, 0.4, 0.55, 0.5)))


@pytest.fixture
def square() -> FloatArray:
    """(W, 4): a room that looks the same from four sides."""
    return np.array(_box(0.0, 0.0, 4.0, 4.0) + _box(1.7, 1.7, 0.6, 0.6))


@pytest.fixture
def other_room() -> FloatArray:
    """(W, 4): a room that is not the lab."""
    return np.array(_box(0.0, 0.0, 5.1, 3.3) + _box(1.0, 0.0, 0.8, 0.5) + _box(3.9, 2.6, 0.4, 0.7))


@pytest.fixture
def places() -> list[Pose2]:
    """In the lab, clear of everything."""
    return [
        Pose2(1.0, 1.2, 0.4),
        Pose2(3.2, 1.4, 2.5),
        Pose2(2.6, 3.3, -1.9),
        Pose2(0.8, 3.2, -0.6),
        Pose2(1.3, 2.4, math.pi),
    ]
