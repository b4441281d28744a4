"""What one network says about edges: upright and level pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.messages import ObjectNetwork
from station_gui.mapping.objects.config import CameraView, FusionConfig

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Edges as they were seen from one place, robot frame.

    `ends_m`: (N, 2, 3); upright ones go from below to above. `upright`: (N,) uint8. `weight`: (N,), one over the
    variance across. `cut`: (N, 2), 1 for an end where the image ends, not the edge.
    `evidence`: (N,), 1 where it was seen from so near that it is a surface's end; from afar it may only be the end of
    what the camera can measure, and counts for less or, with 0, for nothing.
    """

    ends_m: FloatArray
    upright: NDArray[np.uint8]
    weight: FloatArray
    cut: FloatArray
    evidence: FloatArray


def pieces_of(objects: ObjectNetwork, config: FusionConfig, camera: CameraView) -> Pieces:
    """The upright and level connections of a network; others are chords over corners and left out."""
    ends_m = objects.nodes_m.astype(np.float64)[objects.edges.astype(np.int64)].reshape(-1, 2, 3)
    way = ends_m[:, 1] - ends_m[:, 0]
    flat_m = np.hypot(way[:, 0], way[:, 1])
    slope_rad = np.arctan2(np.abs(way[:, 2]), flat_m)
    upright = slope_rad > config.upright_rad
    usable = (upright | (slope_rad < config.level_rad)) & (np.hypot(flat_m, way[:, 2]) >= config.shortest_m)
    usable &= np.isfinite(ends_m).all(axis=(1, 2))
    ends_m, upright = ends_m[usable], upright[usable]
    swap = upright & (ends_m[:, 0, 2] > ends_m[:, 1, 2])
    ends_m[swap] = ends_m[swap, ::-1]
    away_m = np.linalg.norm(ends_m.mean(axis=1), axis=1)
    deviation_m = config.noise_m + config.noise_per_m * away_m
    far = ends_m[:, :, 0].mean(axis=1) - camera.x_m > config.sure_m
    evidence = np.where(far, np.where(upright, 0.0, config.far_level), 1.0)
    return Pieces(ends_m, upright.astype(np.uint8), deviation_m**-2, _cut(ends_m, camera), evidence)


def _cut(ends_m: FloatArray, camera: CameraView) -> FloatArray:
    """(N, 2): which ends lie at the image's border."""
    x, y, z = ends_m[..., 0] - camera.x_m, ends_m[..., 1], ends_m[..., 2] - camera.z_m
    c, s = np.cos(camera.pitch_down_rad), np.sin(camera.pitch_down_rad)
    depth, up = c * x - s * z, s * x + c * z
    wide, high = np.tan(camera.horizontal_rad / 2) * depth, np.tan(camera.vertical_rad / 2) * depth
    at_border = (np.abs(y) > camera.rim * wide) | (np.abs(up) > camera.rim * high) | (depth <= 0)
    return np.asarray(at_border, np.float64)
