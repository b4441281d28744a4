"""From edges to objects (figure 11)."""

from __future__ import annotations

import numpy as np

from station_gui.mapping.objects.config import SurfaceConfig
from station_gui.mapping.objects.fusing.fused_edges import Edges
from station_gui.mapping.objects.kinds import kinds_of
from station_gui.mapping.objects.ransac.ransac import LineFitter
from station_gui.mapping.snapshot import GridMap, ObjectMap


class ObjectBuilder:
    def __init__(self, config: SurfaceConfig, fitter: LineFitter) -> None:
        self._config = config

    def build(self, edges: Edges, grid: GridMap) -> ObjectMap:
        cluster = np.arange(len(edges.ends_m), dtype=np.int32)
        return ObjectMap(edges.ends_m.astype(np.float32), kinds_of(edges.ends_m, cluster, self._config), cluster)
