"""Networks as they came, placed by the pose graph: what step 1 alone shows."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from shared.messages import ObjectNetwork
from station_gui.mapping.objects.config import SurfaceConfig
from station_gui.mapping.objects.fusing.fused_edges import PoseOfScan
from station_gui.mapping.objects.kinds import kinds_of
from station_gui.mapping.snapshot import NO_OBJECTS, ObjectMap


class Networks:
    """The newest `most` networks."""

    def __init__(self, most: int, surface: SurfaceConfig) -> None:
        self._surface = surface
        self._kept: deque[tuple[int, NDArray[np.float64], NDArray[np.int32]]] = deque(maxlen=most)

    def add(self, scan: int, objects: ObjectNetwork) -> None:
        edges = objects.edges.astype(np.int64)
        adjacency = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(objects.nodes_m),) * 2)
        of_node = connected_components(adjacency, directed=False)[1]
        self._kept.append((scan, objects.nodes_m.astype(np.float64)[edges], of_node[edges[:, 0]].astype(np.int32)))

    def placed(self, pose_of_scan: PoseOfScan) -> ObjectMap:
        """Rotate, then translate (eqs 34 and 35)."""
        if not self._kept:
            return NO_OBJECTS
        placed, clusters, first = [], [], 0
        for scan, segments_m, cluster in self._kept:
            placed.append(pose_of_scan(scan).apply_3d(segments_m.reshape(-1, 3)).reshape(-1, 2, 3))
            clusters.append(cluster + first)
            first += int(cluster.max()) + 1
        ends_m, cluster = np.concatenate(placed), np.concatenate(clusters).astype(np.int32)
        return ObjectMap(ends_m.astype(np.float32), kinds_of(ends_m, cluster, self._surface), cluster)
