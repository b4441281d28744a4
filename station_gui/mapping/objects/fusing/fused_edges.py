"""The edges of the map, each once, with the views that they were seen in and what speaks for and against them.

Each edge keeps a bounded number of views as the robot saw them, so that it can be placed again when the pose graph
moves; the cost of a look depends on what is in the map, not on how long the robot has been driving.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import Observation
from station_gui.mapping.objects.config import CameraView, FusionConfig
from station_gui.mapping.objects.fusing import _kernels
from station_gui.mapping.objects.pieces import Pieces

FloatArray = NDArray[np.float64]
PoseOfScan = Callable[[int], Pose2]

_FIRST_ROOM = 128
_UNSEEN, _THROUGH = 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """`ends_m`: (N, 2, 3), map frame; `upright`: (N,) bool; `views`: (N,) how often each was seen, in whole views."""

    ends_m: FloatArray
    upright: NDArray[np.bool_]
    views: NDArray[np.int64]

    def from_above_m(self) -> FloatArray:
        """(L, 2, 2): the level ones."""
        return self.ends_m[~self.upright][:, :, :2]

    def level_views(self) -> NDArray[np.int64]:
        """(L,) how often each level one was seen."""
        return self.views[~self.upright]

    def without_noise(self, clusters: NDArray[np.int64]) -> Edges:
        """Without the level ones that are in no cluster, -1 in `clusters` (L,)."""
        kept = np.ones(len(self.ends_m), np.bool_)
        kept[~self.upright] = clusters >= 0
        return Edges(self.ends_m[kept], self.upright[kept], self.views[kept])


class FusedEdges:
    """One thread; a function of the looks and poses that it was given, in their order."""

    def __init__(self, config: FusionConfig, camera: CameraView) -> None:
        self._config = config
        self._camera = camera
        self._camera_array = camera.as_array()
        self._work = np.zeros((3, config.views))
        self._count = 0
        self._ends_m = np.zeros((_FIRST_ROOM, 2, 3))
        self._upright = np.zeros(_FIRST_ROOM, np.uint8)
        self._log_odds = np.zeros(_FIRST_ROOM)
        self._hits = np.zeros(_FIRST_ROOM)  # views, those from afar for a part
        self._views = np.zeros(_FIRST_ROOM, np.int64)
        self._revision = np.zeros(_FIRST_ROOM, np.int64)  # of the poses that an edge was placed by
        self._settled = 0  # the revision that all were placed by
        self._scan = np.zeros((_FIRST_ROOM, config.views), np.int64)
        self._view_m = np.zeros((_FIRST_ROOM, config.views, 2, 3))  # robot frame of `_scan`
        self._placed_m = np.zeros((_FIRST_ROOM, config.views, 2, 3))  # map frame
        self._weight = np.zeros((_FIRST_ROOM, config.views))
        self._cut = np.zeros((_FIRST_ROOM, config.views, 2))

    def __len__(self) -> int:
        return self._count

    def shown(self) -> Edges:
        """Those that are believed."""
        count = self._count
        believed = self._log_odds[:count] >= self._config.shown_log_odds
        picked = np.flatnonzero(believed & (self._hits[:count] >= self._config.shown_views))
        return Edges(self._ends_m[picked], self._upright[picked] == 1, self._hits[picked].astype(np.int64))

    def look(self, scan: int, map_from_robot: Pose2, pieces: Pieces, observation: Observation, *, keep: bool) -> None:
        """Take what was seen from one place; `keep`: from a new one, otherwise it only counts as evidence."""
        pose = map_from_robot.as_array()
        placed_m = map_from_robot.apply_3d(pieces.ends_m.reshape(-1, 3)).reshape(-1, 2, 3)
        hit: dict[int, float] = {}
        for k, evidence in enumerate(pieces.evidence.tolist()):
            index = self._match(placed_m[k], int(pieces.upright[k]), but=-1)
            if index < 0 and keep:
                index = self._begin(int(pieces.upright[k]))
            if index >= 0:
                hit[index] = max(hit.get(index, 0.0), evidence)
                if keep:
                    self._take(index, scan, placed_m[k], pieces, k)
        touched = sorted(hit)
        for index in touched:
            self._count_hit(index, hit[index], keep=keep)
        if keep:
            for index in touched:
                self._fuse(index)
        self._count_misses(pose, observation, touched)
        for index in reversed(touched):
            self._join(index)
        self._forget()

    def place_again(self, revision: int, share: int, pose_of_scan: PoseOfScan) -> bool:
        """Place at most `share` of the edges that were placed before this revision of the poses, the longest ago first.

        When all are placed, those that came together become one. Returns whether there was something to place.
        """
        if revision == self._settled:
            return False
        old = np.flatnonzero(self._revision[: self._count] != revision)
        for index in old[np.argsort(self._revision[old], kind="stable")][:share].tolist():
            self._place(index, pose_of_scan)
            self._revision[index] = revision
        if len(old) <= share:
            self._settled = revision
            for index in range(self._count - 1, -1, -1):
                if index < self._count:
                    self._join(index)
        return True

    def _place(self, index: int, pose_of_scan: PoseOfScan) -> None:
        for v in range(int(self._views[index])):
            pose = pose_of_scan(int(self._scan[index, v]))
            self._placed_m[index, v] = pose.apply_3d(self._view_m[index, v])
        self._fuse(index)

    def _match(self, piece_m: FloatArray, upright: int, but: int) -> int:
        c = self._config
        return int(
            _kernels.best_match(
                piece_m,
                upright,
                self._ends_m,
                self._upright,
                self._count,
                but,
                c.reach_m,
                c.rise_m,
                c.gap_m,
                c.turn_rad,
            )
        )

    def _begin(self, upright: int) -> int:
        if self._count >= self._config.most_edges:
            return -1
        if self._count == len(self._ends_m):
            self._grow()
        index = self._count
        self._count += 1
        self._upright[index] = upright
        self._log_odds[index] = self._hits[index] = self._views[index] = 0
        self._revision[index] = self._settled
        self._ends_m[index] = np.inf  # nothing matches it before it was fused
        return index

    def _take(self, index: int, scan: int, placed_m: FloatArray, pieces: Pieces, k: int) -> None:
        """Keep one view more; in a full edge it takes the place of the one that says least."""
        at = int(self._views[index])
        if at == self._config.views:
            says = _says(self._view_m[index], self._weight[index])
            at = int(np.argmin(says))
            if says[at] > _says(pieces.ends_m[k : k + 1], pieces.weight[k : k + 1])[0]:
                return
        else:
            self._views[index] += 1
        self._scan[index, at] = scan
        self._view_m[index, at] = pieces.ends_m[k]
        self._placed_m[index, at] = placed_m
        self._weight[index, at] = pieces.weight[k]
        self._cut[index, at] = pieces.cut[k]
        if not np.isfinite(self._ends_m[index, 0, 0]):
            self._ends_m[index] = placed_m

    def _fuse(self, index: int) -> None:
        c, views = self._config, int(self._views[index])
        args = self._placed_m[index], self._weight[index], self._cut[index], views
        if self._upright[index]:
            _kernels.fuse_upright(*args, c.reach_m, c.rise_m, self._work, self._ends_m[index])
        else:
            _kernels.fuse_level(*args, c.gap_m, self._work, self._ends_m[index])

    def _count_hit(self, index: int, evidence: float, *, keep: bool) -> None:
        gain = evidence * self._config.hit_log_odds
        self._log_odds[index] = min(self._log_odds[index] + gain, self._config.most_log_odds)
        self._hits[index] += keep * evidence

    def _count_misses(self, pose: FloatArray, observation: Observation, hit: list[int]) -> None:
        count, geometry, config = self._count, observation.geometry, self._config
        verdict = np.zeros(count, np.uint8)
        _kernels.judge(
            self._ends_m, self._upright, count, pose, self._camera_array, geometry.robot_from_scanner.as_array(),
            observation.ranges_m.astype(np.float64), geometry.first_angle_rad, geometry.step_rad,
            self._camera.scanner_z_m, verdict,
        )  # fmt: skip
        verdict[hit] = 0
        self._log_odds[:count] += config.miss_log_odds * (verdict == _UNSEEN)
        self._log_odds[:count] += config.through_log_odds * (verdict == _THROUGH)

    def _join(self, index: int) -> None:
        other = self._match(self._ends_m[index], int(self._upright[index]), but=index)
        if other < 0 or self._too_long(index, other):
            return
        keep, gone = min(index, other), max(index, other)
        self._merge_views(keep, gone)
        self._log_odds[keep] = min(self._log_odds[keep] + max(self._log_odds[gone], 0.0), self._config.most_log_odds)
        self._hits[keep] += self._hits[gone]
        self._fuse(keep)
        self._remove(gone)

    def _too_long(self, a: int, b: int) -> bool:
        if self._upright[a]:
            return False
        corners = np.vstack((self._ends_m[a], self._ends_m[b]))
        return bool(np.hypot(*np.ptp(corners[:, :2], axis=0)) > self._config.longest_m)

    def _merge_views(self, keep: int, gone: int) -> None:
        """The best views of both."""
        a, b = int(self._views[keep]), int(self._views[gone])

        def both(store: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate((store[keep, :a], store[gone, :b]))

        says = _says(both(self._view_m), both(self._weight))
        best = np.sort(np.argsort(-says, kind="stable")[: self._config.views])
        for store in (self._scan, self._view_m, self._placed_m, self._weight, self._cut):
            store[keep, : len(best)] = both(store)[best]
        self._views[keep] = len(best)

    def _forget(self) -> None:
        for index in np.flatnonzero(self._log_odds[: self._count] < self._config.least_log_odds)[::-1]:
            self._remove(int(index))

    def _remove(self, index: int) -> None:
        """The last one takes its place."""
        last = self._count - 1
        for store in self._stores():
            store[index] = store[last]
        self._count = last

    def _stores(self) -> tuple[NDArray[np.generic], ...]:
        return (
            self._ends_m, self._upright, self._log_odds, self._hits, self._views, self._revision, self._scan,
            self._view_m, self._placed_m, self._weight, self._cut,
        )  # fmt: skip

    def _grow(self) -> None:
        def twice(store: NDArray[np.generic]) -> NDArray[np.generic]:
            return np.concatenate((store, np.zeros_like(store)))

        (
            self._ends_m, self._upright, self._log_odds, self._hits, self._views, self._revision, self._scan,
            self._view_m, self._placed_m, self._weight, self._cut,
        ) = (twice(store) for store in self._stores())  # type: ignore[assignment]  # fmt: skip


def _says(view_m: FloatArray, weight: FloatArray) -> FloatArray:
    """(V,) how much views tell. Near ones are exact, but see a part of an edge only: its length counts more."""
    way = view_m[:, 1] - view_m[:, 0]
    return np.asarray(weight * np.einsum("vk,vk->v", way, way))
