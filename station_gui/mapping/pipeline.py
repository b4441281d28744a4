"""From observations to the map: a function of their sequence, live, recorded or simulated."""

from __future__ import annotations

import math
from collections.abc import Callable

from shared.geometry.se2 import Pose2
from shared.messages import Observation
from shared.runtime.clock import stopwatch_s
from station_gui.mapping.objects.combine import CombineConfig, ObjectCombiner
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import to_points
from station_gui.mapping.slam2d.base import MappingError, SessionSlam
from station_gui.mapping.snapshot import KNOWN_PLACE, MapSnapshot, Tracking

MakeSlam = Callable[[SavedMap | None, bool], SessionSlam]  # from a map to begin with, and whether it is not to change

_FARTHEST_M = 10_000.0  # no robot of ours drives so far: whoever says so is not one


class MappingPipeline:
    """Observation → SLAM → grid and 3D objects → snapshot. One thread.

    What comes twice or late is left out; a robot that was started again, or another one, begins a new map, or,
    where a map was given, has to be found in it again.
    """

    def __init__(self, make_slam: MakeSlam, combine: CombineConfig) -> None:
        self._make_slam = make_slam
        self._combine = combine
        self._revision = 0
        self.maps_begun = 0
        self._given: SavedMap | None = None
        self._fixed = False
        self._begin()

    def open_map(self, given: SavedMap, *, fixed: bool) -> None:
        """Forget the present map and begin with this one; `fixed`: only localise in it. Raises `MappingError`."""
        self._given, self._fixed = given, fixed
        self._begin()
        self._revision += 1

    def saved_map(self) -> SavedMap:
        """Raises `MappingError` while there is nothing to save."""
        return self._slam.saved()

    def _begin_again(self) -> None:
        """What has been added to a given map is kept."""
        if self._given is not None:
            self._given = self._slam.saved()
        self._begin()

    def _begin(self) -> None:
        self._slam = self._make_slam(self._given, self._fixed)
        self._combiner = ObjectCombiner(self._combine)
        self.maps_begun += 1
        self._observations = 0
        self._boot_id: int | None = None
        self._sequence = -1
        self._stamp_s = -math.inf
        self._map_from_robot = Pose2()
        self._odom_from_robot = Pose2()
        self._slam_s = 0.0

    @property
    def observations(self) -> int:
        return self._observations

    @property
    def map_from_robot(self) -> Pose2:
        """At the newest observation, as it was believed then."""
        return self._map_from_robot

    @property
    def tracking(self) -> Tracking:
        return self._slam.tracking

    def add(self, observation: Observation) -> bool:
        """Take the next observation; False for one that came before, or after a later one.

        Raises `MappingError` for one that cannot be.
        """
        pose = observation.odom_from_robot
        if max(abs(pose.x_m), abs(pose.y_m)) > _FARTHEST_M:
            raise MappingError(f"observation {observation.sequence} claims to be {pose.x_m:.0f}, {pose.y_m:.0f} m away")
        if self._boot_id is not None and observation.boot_id != self._boot_id:
            self._begin_again()
        if observation.sequence <= self._sequence:
            return False
        began_s = stopwatch_s()
        self._map_from_robot = self._slam.add(to_points(observation))
        self._boot_id, self._sequence = observation.boot_id, observation.sequence
        self._slam_s = stopwatch_s() - began_s
        if observation.has_objects and self.tracking in KNOWN_PLACE:
            self._combiner.add(self._observations, self._map_from_robot, observation.objects)
        self._observations += 1
        self._stamp_s = observation.stamp_s
        self._odom_from_robot = pose
        self._revision += 1
        return True

    def finish(self) -> None:
        """No more observations come."""
        self._slam.finish()
        if self._observations:
            self._map_from_robot = self._slam.pose_of_scan(self._observations - 1)

    def snapshot(self) -> MapSnapshot:
        """The map as it is believed now."""
        began_s = stopwatch_s()
        objects = self._combiner.object_map(self._slam)
        combine_s = stopwatch_s() - began_s
        return MapSnapshot(
            revision=self._revision,
            stamp_s=self._stamp_s,
            map_from_robot=self._map_from_robot,
            map_from_odom=self._map_from_robot @ self._odom_from_robot.inverse(),
            grid=self._slam.grid(),
            objects=objects,
            trajectory=self._slam.trajectory(),
            closures=self._slam.closures(),
            observations=self._observations,
            slam_s=self._slam_s,
            combine_s=combine_s,
            tracking=self._slam.tracking,
            places=self._slam.places,
            fixed=self._slam.fixed,
        )
