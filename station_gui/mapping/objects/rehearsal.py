"""Runs every kernel of the 3D map once, so that neither compiling nor loading one holds up an observation."""

from __future__ import annotations

from functools import cache

import numpy as np

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from station_gui.mapping.objects.config import CombineConfig
from station_gui.mapping.objects.dbscan.dbscan import nearest_clusters
from station_gui.mapping.objects.fusing.fused_edges import FusedEdges
from station_gui.mapping.objects.pieces import pieces_of
from station_gui.mapping.objects.ransac.ransac import LineFitter
from station_gui.mapping.objects.reference import first_clusters

_CELL_M = 0.02


@cache
def rehearse() -> None:
    """Once in the life of the process."""
    config = CombineConfig()
    nodes = np.array([[1.5, 0.0, 0.0], [1.5, 0.0, 0.3], [1.5, 0.4, 0.3]], np.float32)
    network = ObjectNetwork(nodes, np.array([[0, 1], [1, 2]], np.uint16))
    geometry = ScanGeometry(-1.0, 0.01, 0.0, 0.06, 4.0, Pose2())
    seen = Observation(0, 0.0, Pose2(), 0.0, 0.0, geometry, np.full(200, 2.0, np.float32), network, True)
    pieces = pieces_of(network, config.fusion, config.camera)
    edges = FusedEdges(config.fusion, config.camera)
    for scan in range(2):
        edges.look(scan, Pose2(), pieces, seen, keep=True)
    known = edges.shown()
    clusters = first_clusters(known.from_above_m(), known.level_views(), config.reference)
    cells_m = np.column_stack((np.full(20, 1.5), _CELL_M * np.arange(20)))
    owners = nearest_clusters(cells_m, known.from_above_m(), clusters, config.reference.node_reach_m)
    LineFitter(config.reference, np.random.default_rng(1)).fit(cells_m, owners, _CELL_M)
