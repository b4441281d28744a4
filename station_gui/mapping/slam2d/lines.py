"""What every method does first with a scan."""

from __future__ import annotations

import math

import numpy as np

from station_gui.mapping.scan import PointScan
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.config import NormalConfig
from station_gui.mapping.slam2d.matching.scan_matcher import LineScan, to_lines


def lines_of(scan: PointScan, config: NormalConfig, max_range_m: float = math.inf) -> LineScan:
    """Points and normals of a scan, robot frame, without points farther than `max_range_m` along an axis.

    Raises MappingError for a scan that holds anything but finite numbers.
    """
    if not (np.isfinite(scan.points_m).all() and np.isfinite(scan.odom_from_robot.as_array()).all()):
        raise MappingError(f"the scan at {scan.stamp_s:.3f} s holds numbers that are not finite")
    points_m = scan.points_m
    if max_range_m < math.inf:
        points_m = points_m[np.abs(points_m).max(axis=1, initial=0.0) <= max_range_m]
    return to_lines(points_m, scan.origin_m, config)
