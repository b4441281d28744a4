"""Three beams become one (paper 1, section 3.1): less to send, and less noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import RawScan
from shared.messages import ScanGeometry

FACTOR = 3


@dataclass(frozen=True, slots=True)
class ScanFilterConfig:
    same_surface_m: float = 0.03  # neighbours closer than this plus the share below lie on one surface
    same_surface_share: float = 0.03


def thinned_geometry(geometry: ScanGeometry) -> ScanGeometry:
    """Where the beams of a thinned scan point: each stands for the middle one of its three."""
    return replace(
        geometry,
        first_angle_rad=geometry.first_angle_rad + geometry.step_rad,
        step_rad=FACTOR * geometry.step_rad,
        beam_interval_s=FACTOR * geometry.beam_interval_s,
    )


def thin(scan: RawScan, geometry: ScanGeometry, config: ScanFilterConfig) -> RawScan:
    """A third of the beams; a beam with no neighbour at its range is a mixed pixel and dropped.

    Where all three lie on one surface their mean is taken, which hides noise and stays on the middle beam;
    where only two do, the middle one is kept as it is if it is one of them.
    """
    count = len(scan.ranges_m) // FACTOR
    ranges = scan.ranges_m[: count * FACTOR].astype(np.float32).reshape(count, FACTOR)
    in_range = (ranges >= geometry.range_min_m) & (ranges <= geometry.range_max_m)
    left, middle, right = np.where(in_range, ranges, np.nan).T
    with_left = _on_one_surface(left, middle, config)
    with_right = _on_one_surface(middle, right, config)
    thinned = np.where(with_left | with_right, middle, np.nan)
    both = with_left & with_right
    thinned[both] = (left[both] + middle[both] + right[both]) / 3
    return RawScan(scan.stamp_s + geometry.beam_interval_s, thinned.astype(np.float32))


def _on_one_surface(a_m: NDArray[np.float32], b_m: NDArray[np.float32], config: ScanFilterConfig) -> NDArray[np.bool_]:
    tolerance = config.same_surface_m + config.same_surface_share * b_m
    return np.asarray(np.abs(a_m - b_m) <= tolerance)  # NaN compares false
