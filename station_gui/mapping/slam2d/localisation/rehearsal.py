"""Looks for a robot in a small room once, so that neither compiling nor loading a kernel holds up a scan."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.keyframes import Keyframe
from station_gui.mapping.slam2d.localisation.config import LocalisationConfig
from station_gui.mapping.slam2d.localisation.reference import Reference
from station_gui.mapping.slam2d.localisation.relocaliser import Relocaliser
from station_gui.mapping.slam2d.matching.scan_matcher import to_lines

_MOST_SCANS = 40


@cache
def rehearse_search() -> None:
    """Once in the life of the process."""
    config = LocalisationConfig()
    angle = np.linspace(0.0, math.tau, 200, endpoint=False)
    points_m = np.column_stack((2.0 * np.cos(angle), 1.5 * np.sin(angle) + 0.5))
    lines = to_lines(points_m, np.zeros(2), config.trail.normals)
    points, normals = lines.points_m.astype(np.float32), lines.normals.astype(np.float32)
    keyframe = Keyframe(0.0, 0, np.zeros(3), points, normals, np.zeros(2))
    reference = Reference(config.reference, config.trail.match, GridConfig(), [keyframe], np.zeros((1, 3)))
    relocaliser = Relocaliser(config, reference)
    for k in range(_MOST_SCANS):
        relocaliser.add(PointScan(0.1 * k, Pose2(), np.zeros(2), points_m))
        if relocaliser.settled:
            break
