"""Where a camera must stand to see all of a box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MARGIN = 1.04
_ROUNDS = 4  # the perspective shifts what is near more than what is far; this is enough to settle


@dataclass(frozen=True, slots=True)
class CameraAngles:
    """From where the camera looks at its centre, and its horizontal field of view."""

    azimuth_rad: float
    elevation_rad: float
    field_of_view_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A centre (3,) to look at, and how far away to stand from it."""

    centre_m: NDArray[np.float64]
    distance_m: float


def fit_box(low_m: NDArray[np.float64], high_m: NDArray[np.float64], angles: CameraAngles, aspect: float) -> Fit:
    """The camera of a picture `aspect` times as wide as high that shows the box, in the middle and as big as can be."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high_m - low_m) + low_m
    axes = _camera_axes(angles)
    tangents = np.tan(angles.field_of_view_rad / 2) / np.array([1.0, aspect])
    centre_m = (low_m + high_m) / 2
    distance_m = 1.0
    for _ in range(_ROUNDS):
        seen = (corners - centre_m) @ axes.T
        distance_m = max(1.0, _MARGIN * float((seen[:, 2:] + np.abs(seen[:, :2]) / tangents).max()))
        on_picture = seen[:, :2] / (distance_m - seen[:, 2:])
        off = (on_picture.min(axis=0) + on_picture.max(axis=0)) / 2 * distance_m
        centre_m = centre_m + off @ axes[:2]
    return Fit(centre_m, distance_m)


def _camera_axes(angles: CameraAngles) -> NDArray[np.float64]:
    """(3, 3): right, up and towards the camera, map frame."""
    ca, sa = np.cos(angles.azimuth_rad), np.sin(angles.azimuth_rad)
    ce, se = np.cos(angles.elevation_rad), np.sin(angles.elevation_rad)
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])
