"""From observations to the map: a function of their sequence, live, recorded or simulated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from shared.geometry.se2 import Pose2
from shared.messages import Observation
from shared.runtime.clock import stopwatch_s
from station_gui.mapping.objects.combine import ObjectCombiner
from station_gui.mapping.objects.config import CombineConfig
from station_gui.mapping.saved_map import SavedMap
from station_gui.mapping.scan import to_points
from station_gui.mapping.slam2d.base import MappingError, SessionSlam
from station_gui.mapping.snapshot import KNOWN_PLACE, MapSnapshot, Tracking

MakeSlam = Callable[[SavedMap | None, bool], SessionSlam]  # from a map to begin with, and whether it is not to change

_FARTHEST_M = 10_000.0  # no robot of ours drives so far: whoever says so is not one
_HEARD_OF_ANOTHER = 3  # observations in a row of another start, for a single one may be a stray
_WORTH_KEEPING = 10  # keyframes: in a smaller map nobody can be found again
_BETWEEN_SESSIONS_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class OpenedMap:
    """Ready to be gone on with."""

    slam: SessionSlam
    given: SavedMap
    fixed: bool


class MappingPipeline:
    """Observation → SLAM → grid and 3D objects → snapshot. One thread.

    What comes twice or late is left out. A robot that was started again, or another one, has to be found in the map
    that there is; it begins a new one where there is hardly any.
    """

    def __init__(self, make_slam: MakeSlam, combine: CombineConfig) -> None:
        self._make_slam = make_slam
        self._combine = combine
        self._revision = 0
        self.maps_begun = 0
        self._given: SavedMap | None = None
        self._fixed = False
        self._heard: list[Observation] = []  # of another start
        self._begin(self._make_slam(None, False))

    def open_map(self, given: SavedMap, *, fixed: bool) -> None:
        """Forget the present map and begin with this one; `fixed`: only localise in it.

        Raises `MappingError` for one that cannot be used; the present one stays.
        """
        self.adopt(self.prepare(given, fixed=fixed))

    def prepare(self, given: SavedMap, *, fixed: bool) -> OpenedMap:
        """The part of `open_map` that takes long and changes nothing: any thread may do it. Raises `MappingError`."""
        slam = self._make_slam(given, fixed)
        slam.grid()  # a map that cannot be drawn would never be seen
        return OpenedMap(slam, given, fixed)

    def adopt(self, opened: OpenedMap) -> None:
        """Begin with a map that was prepared, once."""
        self._given, self._fixed = opened.given, opened.fixed
        self._begin(opened.slam)
        self._revision += 1

    def saved_map(self) -> SavedMap:
        """Raises `MappingError` while there is nothing to save."""
        return self._slam.saved()

    def _begin_again(self) -> None:
        """With what has been mapped so far."""
        self._given = self._worth_keeping()
        self._begin(self._make_slam(self._given, self._fixed))

    def _worth_keeping(self) -> SavedMap | None:
        try:
            saved = self._slam.saved()
        except MappingError:
            return self._given
        return saved if self._given is not None or len(saved.keyframes) >= _WORTH_KEEPING else None

    def _begin(self, slam: SessionSlam) -> None:
        self._slam = slam
        stamps = [keyframe.stamp_s for keyframe in self._given.keyframes] if self._given is not None else []
        self._sessions_end_s = max(stamps, default=-math.inf)
        self._later_s = 0.0  # by which the stamps of this session come later in the map
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
            return self._hear_of_another(observation)
        if not self._map(observation):
            return False
        self._heard = []
        return True

    def _hear_of_another(self, observation: Observation) -> bool:
        """Another start, once there is no doubt about it; nothing of it is lost."""
        heard = self._heard
        if heard and observation.boot_id != heard[-1].boot_id:
            heard.clear()
        if heard and observation.sequence <= heard[-1].sequence:
            return False
        heard.append(observation)
        if len(heard) < _HEARD_OF_ANOTHER:
            return False
        self._heard = []
        self._begin_again()
        for one in heard:
            self._map(one)
        return True

    def _map(self, observation: Observation) -> bool:
        if observation.sequence <= self._sequence:
            return False
        if self._boot_id is None:
            self._later_s = max(0.0, self._sessions_end_s + _BETWEEN_SESSIONS_S - observation.stamp_s)
        began_s = stopwatch_s()
        scan = to_points(observation)
        self._map_from_robot = self._slam.add(replace(scan, stamp_s=scan.stamp_s + self._later_s))
        self._boot_id, self._sequence = observation.boot_id, observation.sequence
        self._slam_s = stopwatch_s() - began_s
        if self.tracking in KNOWN_PLACE:
            self._combiner.add(self._observations, self._map_from_robot, observation, self._slam)
        self._observations += 1
        self._stamp_s = observation.stamp_s
        self._odom_from_robot = observation.odom_from_robot
        self._revision += 1
        return True

    def finish(self) -> None:
        """No more observations come."""
        self._slam.finish()
        self._combiner.finish(self._slam)
        if self._observations:
            self._map_from_robot = self._slam.pose_of_scan(self._observations - 1)

    def snapshot(self) -> MapSnapshot:
        """The map as it is believed now."""
        grid = self._slam.grid()
        began_s = stopwatch_s()
        objects = self._combiner.object_map(self._slam, grid)
        combine_s = stopwatch_s() - began_s
        return MapSnapshot(
            revision=self._revision,
            stamp_s=self._stamp_s,
            map_from_robot=self._map_from_robot,
            map_from_odom=self._map_from_robot @ self._odom_from_robot.inverse(),
            grid=grid,
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
