"""Which upright edges only go at least so high: where the image ended, or what could be seen from afar."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_UPRIGHT_COS = 0.94  # 20 degrees
_MEETS_M = 0.06  # as ends that meet become one (`SurfaceConfig.join_m`)
_FINE_M = 1e-6


def open_tops(segments_m: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(S,) of the edges of a map of objects, (S, 2, 3): upright ones whose upper end no level edge meets.

    A thing is known to be as high as an edge along its top was seen. Where there is none, its sides may go on.
    """
    ends_m = np.asarray(segments_m, np.float64).reshape(-1, 2, 3)
    way = ends_m[:, 1] - ends_m[:, 0]
    upright = np.abs(way[:, 2]) > _UPRIGHT_COS * np.maximum(np.linalg.norm(way, axis=1), _FINE_M)
    top_m = np.take_along_axis(ends_m, ends_m[:, :, 2].argmax(axis=1)[:, None, None], axis=1)[:, 0]
    open_top = np.zeros(len(ends_m), np.bool_)
    open_top[upright] = _away_m(top_m[upright], ends_m[~upright]) > _MEETS_M
    return open_top


def _away_m(points_m: NDArray[np.float64], edges_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,) distances of points, (P, 3), to the nearest of the edges, (E, 2, 3)."""
    way = edges_m[:, 1] - edges_m[:, 0]
    from_start_m = points_m[:, None] - edges_m[:, 0]
    square = np.maximum(np.einsum("ek,ek->e", way, way), _FINE_M)
    along = np.clip(np.einsum("pek,ek->pe", from_start_m, way) / square, 0.0, 1.0)
    away_m = np.linalg.norm(from_start_m - along[..., None] * way, axis=2)
    return np.asarray(away_m.min(axis=1, initial=np.inf), np.float64)
