"""Which objects are large: red in the paper; the others are blue."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station_gui.mapping.objects.config import SurfaceConfig
from station_gui.mapping.snapshot import ObjectKind


def kinds_of(ends_m: NDArray[np.float64], cluster: NDArray[np.int32], config: SurfaceConfig) -> NDArray[np.uint8]:
    """(S,) of each edge, by the size of its object; `ends_m`: (S, 2, 3), `cluster`: (S,) counted from 0."""
    count = int(cluster.max(initial=-1)) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, cluster, ends_m.min(axis=1))
    np.maximum.at(high, cluster, ends_m.max(axis=1))
    size_m = high - low
    large = (np.hypot(size_m[:, 0], size_m[:, 1]) >= config.large_extent_m) | (size_m[:, 2] >= config.large_height_m)
    return np.where(large, ObjectKind.LARGE, ObjectKind.SMALL).astype(np.uint8)[cluster]
