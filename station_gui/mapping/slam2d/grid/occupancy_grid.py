"""A growing occupancy grid that follows its scans when the graph moves them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.slam2d.base import MappingError
from station_gui.mapping.slam2d.config import GridConfig
from station_gui.mapping.slam2d.grid import _kernels
from station_gui.mapping.slam2d.share import Share, Task
from station_gui.mapping.snapshot import GridMap

_MARGIN_M = 0.5
_ROWS_AT_ONCE = 32


@dataclass(frozen=True, slots=True)
class _Box:
    """In metres, map frame."""

    low_x: float
    low_y: float
    high_x: float
    high_y: float

    def joined(self, other: _Box) -> _Box:
        return _Box(
            min(self.low_x, other.low_x),
            min(self.low_y, other.low_y),
            max(self.high_x, other.high_x),
            max(self.high_y, other.high_y),
        )

    def contains(self, other: _Box) -> bool:
        return (
            self.low_x <= other.low_x
            and self.low_y <= other.low_y
            and self.high_x >= other.high_x
            and self.high_y >= other.high_y
        )

    def is_finite(self) -> bool:
        return all(map(math.isfinite, (self.low_x, self.low_y, self.high_x, self.high_y)))

    def widened(self, by_m: float) -> _Box:
        return _Box(self.low_x - by_m, self.low_y - by_m, self.high_x + by_m, self.high_y + by_m)

    def cells(self, cell_m: float) -> float:
        return (self.high_x - self.low_x + 2 * cell_m) * (self.high_y - self.low_y + 2 * cell_m) / cell_m**2


@dataclass(slots=True, eq=False)
class _Drawn:
    """A scan and the pose it was drawn at."""

    points_m: NDArray[np.float32]
    scanner_m: NDArray[np.float64]
    pose: NDArray[np.float64]
    reach_m: float
    left_out: bool = False

    def box(self, pose: NDArray[np.float64]) -> _Box:
        """Round the scanner and all hits."""
        corners = Pose2.from_array(pose).apply(np.vstack((self.points_m, self.scanner_m)))
        (low_x, low_y), (high_x, high_y) = corners.min(axis=0), corners.max(axis=0)
        return _Box(float(low_x), float(low_y), float(high_x), float(high_y))


class DrawableScan(Protocol):
    """`points_m`: (N, 2) and `scanner_m`: (2,), robot frame."""

    @property
    def points_m(self) -> NDArray[np.float32]: ...
    @property
    def scanner_m(self) -> NDArray[np.float64]: ...


class OccupancyGrid:
    """Counts of hits and passes per cell: whole numbers, so that a scan can be taken out exactly as it was put in."""

    def __init__(self, config: GridConfig) -> None:
        self._config = config
        self._cell_m = config.cell_m
        self._scans: list[_Drawn] = []
        self._origin_m = (0.0, 0.0)
        self._hits = np.zeros((1, 1), np.int32)
        self._passes = np.zeros((1, 1), np.int32)
        self._probability = np.full((1, 1), 0.5, np.float32)
        self._dirty: _Box | None = None

    @property
    def consumed(self) -> int:
        """How many scans were given, those that were left out included."""
        return len(self._scans)

    def add_all(self, scans: Sequence[DrawableScan], poses: NDArray[np.float64]) -> None:
        """Draw further scans at `poses`, (N, 3).

        Raises MappingError where the map would become larger than is allowed; those scans are left out.
        """
        fault: MappingError | None = None
        self._make_room_for_all(scans, poses)
        for scan, pose in zip(scans, poses, strict=True):
            try:
                self.add(scan.points_m, scan.scanner_m, pose)
            except MappingError as error:
                fault = error
        if fault is not None:
            raise fault

    def _make_room_for_all(self, scans: Sequence[DrawableScan], poses: NDArray[np.float64]) -> None:
        """Once for many scans; where they do not all fit each is tried by itself."""
        box: _Box | None = None
        for scan, pose in zip(scans, poses, strict=True):
            own = self._drawn(scan.points_m, scan.scanner_m, pose).box(pose)
            box = own if box is None else box.joined(own)
        if box is not None:
            with contextlib.suppress(MappingError):
                self._make_room(box)

    def add(self, points_m: NDArray[np.float32], scanner_m: NDArray[np.float64], pose: NDArray[np.float64]) -> None:
        """Draw one more scan. `points_m`: (N, 2) and `scanner_m`: (2,), robot frame; `pose`: (3,), map frame.

        Raises MappingError where the map would become larger than is allowed; the scan is left out.
        """
        scan = self._drawn(points_m, scanner_m, pose)
        try:
            self._make_room(scan.box(pose))
        except MappingError:
            self._scans.append(_Drawn(points_m[:0], scanner_m, pose.copy(), 0.0, left_out=True))
            raise
        self._scans.append(scan)
        self._trace(scan, 1)

    def _drawn(
        self, points_m: NDArray[np.float32], scanner_m: NDArray[np.float64], pose: NDArray[np.float64]
    ) -> _Drawn:
        reach = np.hypot(points_m[:, 0] - scanner_m[0], points_m[:, 1] - scanner_m[1])
        near = reach <= self._config.max_range_m
        farthest_m = float(reach[near].max(initial=0.0))
        return _Drawn(points_m[near], scanner_m, pose.copy(), farthest_m + float(np.hypot(*scanner_m)))

    def moved(self, poses: NDArray[np.float64]) -> NDArray[np.int64]:
        """Which scans are to be drawn again; `poses`: (consumed, 3)."""
        if not len(self._scans):
            return np.zeros(0, np.int64)
        drawn = np.array([scan.pose for scan in self._scans])
        change = poses - drawn
        turned_m = np.abs(np.remainder(change[:, 2] + math.pi, math.tau) - math.pi) * [s.reach_m for s in self._scans]
        far_m = np.hypot(change[:, 0], change[:, 1]) + turned_m
        return np.flatnonzero(far_m > self._config.moved_cells * self._cell_m)

    def move(self, poses: NDArray[np.float64]) -> None:
        """`poses`: (consumed, 3): where the scans are believed to be now; those that moved are drawn again."""
        moved = self.moved(poses)
        if 2 * len(moved) > len(self._scans):
            for scan, pose in zip(self._scans, poses, strict=True):
                scan.pose = pose.copy()
            self._redraw()
            return
        for index in moved:
            scan = self._scans[index]
            if scan.left_out:
                continue
            self._make_room(scan.box(poses[index]))
            self._trace(scan, -1)
            scan.pose = poses[index].copy()
            self._trace(scan, 1)

    def snapshot(self) -> GridMap:
        self._refresh()
        probability = self._probability.copy()
        probability.setflags(write=False)
        return GridMap(probability, self._origin_m, self._cell_m)

    def refresh_slowly(self, share: Share) -> Task:
        """The work of the next snapshot, as far as the share goes at a time; nothing may be added meanwhile."""
        while self._dirty is not None:
            if share.left <= 0:
                yield
            whole = self._dirty
            high_y = whole.low_y + _ROWS_AT_ONCE * self._cell_m
            self._dirty = _Box(whole.low_x, whole.low_y, whole.high_x, min(high_y, whole.high_y))
            self._refresh()
            share.take(_ROWS_AT_ONCE * self._hits.shape[1])
            if high_y < whole.high_y:
                self._dirty = _Box(whole.low_x, high_y, whole.high_x, whole.high_y)

    def _trace(self, scan: _Drawn, change: int) -> None:
        _kernels.trace_scan(
            scan.points_m, scan.scanner_m, scan.pose, *self._origin_m, self._cell_m, self._config.max_range_m, change,
            self._hits, self._passes,
        )  # fmt: skip
        box = scan.box(scan.pose)
        self._dirty = box if self._dirty is None else self._dirty.joined(box)

    def _make_room(self, box: _Box) -> None:
        """Grow, and coarsen where growing alone would take too many cells."""
        height, width = self._hits.shape
        origin_x, origin_y = self._origin_m
        empty = not self._scans and self._hits.size == 1
        if not box.is_finite():
            raise MappingError("the map would be of no finite size")
        now = _Box(origin_x, origin_y, origin_x + width * self._cell_m, origin_y + height * self._cell_m)
        if not empty and now.contains(box.widened(self._cell_m)):
            return
        wanted = box if empty else now.joined(box)
        if self._affordable_cell_m(wanted) > self._cell_m:
            self._redraw(extra=box)
        else:
            self._grow(wanted, empty=empty)

    def _affordable_cell_m(self, box: _Box) -> float:
        """The finest cell that this area may have."""
        cell_m = self._cell_m
        while box.cells(cell_m) > 0.8 * self._config.max_cells:
            cell_m *= 2
            if cell_m > self._config.coarsest_cell_m:
                raise MappingError(
                    f"the map would be {box.high_x - box.low_x:.0f} m x {box.high_y - box.low_y:.0f} m: "
                    f"more than {self._config.max_cells} cells of {self._config.coarsest_cell_m} m"
                )
        return cell_m

    def _grow(self, box: _Box, *, empty: bool) -> None:
        """Copy the counts into a larger array whose cells lie on the same raster."""
        cell_m = self._cell_m
        wider = box.widened(min(0.05 * max(box.high_x - box.low_x, box.high_y - box.low_y), 2.0) + _MARGIN_M)
        low_column, low_row = math.floor(wider.low_x / cell_m), math.floor(wider.low_y / cell_m)
        high_column, high_row = math.ceil(wider.high_x / cell_m), math.ceil(wider.high_y / cell_m)
        shape = (high_row - low_row, high_column - low_column)
        hits, passes = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
        probability = np.full(shape, 0.5, np.float32)
        if not empty:
            row = round(self._origin_m[1] / cell_m) - low_row
            column = round(self._origin_m[0] / cell_m) - low_column
            place = np.s_[row : row + self._hits.shape[0], column : column + self._hits.shape[1]]
            hits[place], passes[place], probability[place] = self._hits, self._passes, self._probability
        self._hits, self._passes, self._probability = hits, passes, probability
        self._origin_m = (low_column * cell_m, low_row * cell_m)

    def _redraw(self, extra: _Box | None = None) -> None:
        """All scans anew, at their poses."""
        box = extra
        for scan in self._scans:
            if scan.left_out:
                continue
            own = scan.box(scan.pose)
            box = own if box is None else box.joined(own)
        if box is None:
            return
        self._cell_m = self._affordable_cell_m(box)
        self._grow(box, empty=True)
        self._dirty = None
        for scan in self._scans:
            if not scan.left_out:
                self._trace(scan, 1)

    def _refresh(self) -> None:
        """Probabilities where counts changed."""
        if self._dirty is None:
            return
        height, width = self._hits.shape
        reach = self._config.thin_reach_cells + 1
        low_column = math.floor((self._dirty.low_x - self._origin_m[0]) / self._cell_m) - reach
        low_row = math.floor((self._dirty.low_y - self._origin_m[1]) / self._cell_m) - reach
        high_column = math.ceil((self._dirty.high_x - self._origin_m[0]) / self._cell_m) + reach
        high_row = math.ceil((self._dirty.high_y - self._origin_m[1]) / self._cell_m) + reach
        config = self._config
        _kernels.fill_probability(
            self._hits, self._passes, max(low_row, 0), min(high_row, height - 1), max(low_column, 0),
            min(high_column, width - 1), config.hit_log_odds, config.miss_log_odds, config.limit_log_odds,
            config.thin_share, config.thin_reach_cells, self._probability,
        )  # fmt: skip
        self._dirty = None
