"""2D–3D combination (paper 1, section 3.3): objects that the robot saw become one map, corrected against the 2D map.

What is seen enters the fused edges at once, placed by the pose graph (step 1). Steps 2 to 5 are a function of these
edges and of the occupancy grid, so that a map does not depend on how often somebody looked at it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2, wrap_angle
from shared.messages import Observation
from station_gui.mapping.objects.config import CombineConfig
from station_gui.mapping.objects.dbscan.dbscan import nearest_clusters
from station_gui.mapping.objects.fusing.fused_edges import Edges, FusedEdges
from station_gui.mapping.objects.networks import Networks
from station_gui.mapping.objects.pieces import pieces_of
from station_gui.mapping.objects.ransac.ransac import LineFitter
from station_gui.mapping.objects.reference import aligned, first_clusters, joined_owners
from station_gui.mapping.objects.rehearsal import rehearse
from station_gui.mapping.objects.repeats import Repeats
from station_gui.mapping.objects.surfaces import ObjectBuilder
from station_gui.mapping.slam2d.base import Slam
from station_gui.mapping.snapshot import NO_OBJECTS, GridMap, ObjectMap


class ObjectCombiner:
    """One thread; a function of the observations and of the poses and grids that belong to them."""

    def __init__(self, config: CombineConfig) -> None:
        rehearse()
        self._config = config
        self._fitter = LineFitter(config.reference, np.random.default_rng(config.seed))
        self._builder = ObjectBuilder(config.surface, config.reference, self._fitter)
        self._edges = FusedEdges(config.fusion, config.camera)
        self._shown = self._edges.shown()
        self._networks = Networks(config.most_networks, config.surface)
        self._repeats = Repeats()
        self._map = NO_OBJECTS
        self._before: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        self._last: tuple[Pose2, float] | None = None

    def add(self, scan: int, map_from_robot: Pose2, observation: Observation, slam: Slam) -> None:
        """Step 1: place what was seen with the scan of this index (eqs 34 and 35), and go on placing what moved."""
        placed = self._edges.place_again(slam.revision, self._config.edges_at_once, slam.pose_of_scan)
        elsewhere = observation.has_objects and self._look(scan, map_from_robot, observation)
        if placed or elsewhere:
            self._shown = self._edges.shown()

    def _look(self, scan: int, map_from_robot: Pose2, observation: Observation) -> bool:
        """Take what was seen; whether it was seen from another place than the last, or after some time.

        What is measured in between is evidence, and shows when the robot has moved on.
        """
        pieces = pieces_of(observation.objects, self._config.fusion, self._config.camera)
        measured = self._repeats.is_measurement(pieces.ends_m, observation.odom_from_robot)
        moved, late = self._has_moved(map_from_robot, observation.stamp_s)
        if moved or late:
            self._last = (map_from_robot, observation.stamp_s)
        if 2 not in self._config.steps:
            if moved and len(observation.objects.edges):
                self._networks.add(scan, observation.objects)
        elif measured or moved or late:
            self._edges.look(scan, map_from_robot, pieces, observation, keep=measured or moved)
        return moved or late

    def finish(self, slam: Slam) -> None:
        """No more observations come: place all that has moved."""
        self._edges.place_again(slam.revision, len(self._edges), slam.pose_of_scan)
        self._shown = self._edges.shown()

    def object_map(self, slam: Slam, grid: GridMap) -> ObjectMap:
        """The map of objects as it is believed now."""
        if 2 not in self._config.steps:
            return self._networks.placed(slam.pose_of_scan)
        return self._combined(self._shown, grid)

    def _combined(self, edges: Edges, grid: GridMap) -> ObjectMap:
        config, steps = self._config.reference, self._config.steps
        lines_m = edges.from_above_m()
        clusters = first_clusters(lines_m, edges.level_views(), config)  # step 2, eqs 36, 37, Algorithm 1
        edges = edges.without_noise(clusters)
        if 3 not in steps:
            return self._builder.without_reference(edges)
        nodes_m = grid.occupied_m()
        if self._is_as_before(edges, nodes_m):
            return self._map
        owners = nearest_clusters(nodes_m, lines_m, clusters, config.node_reach_m)  # step 3, P > 0.750
        reference_m = self._fitter.fit(nodes_m, owners, grid.cell_m)[0]  # eqs 38–40, Algorithm 2
        if 4 in steps:
            owners = joined_owners(nodes_m, reference_m, config)  # step 4
            reference_m = self._fitter.fit(nodes_m, owners, grid.cell_m)[0]
        if 5 in steps:
            edges = aligned(edges, reference_m, config)  # step 5
        self._map = self._builder.build(edges, reference_m, nodes_m, grid.cell_m)  # figure 11, surfaces
        return self._map

    def _is_as_before(self, edges: Edges, nodes_m: NDArray[np.float64]) -> bool:
        """What has not changed is not worked out again; most observations show known things from known places."""
        before, self._before = self._before, (edges.ends_m, nodes_m)
        return before is not None and all(map(np.array_equal, before, self._before))

    def _has_moved(self, pose: Pose2, stamp_s: float) -> tuple[bool, bool]:
        """Whether this is another place than the last, and whether some time has gone by."""
        if self._last is None:
            return True, True
        last, last_s = self._last
        turned_rad = abs(wrap_angle(pose.theta_rad - last.theta_rad))
        moved = pose.distance_m(last) >= self._config.keep_every_m or turned_rad >= self._config.keep_every_rad
        return moved, stamp_s - last_s >= self._config.look_every_s
