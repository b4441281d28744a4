"""The floor as the robot itself has seen it: coarse, in the odom frame, so that it can explore without a station."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.control.ground import _kernels
from robot_app.control.seen_ground import lattice
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry

_EVERY = 2  # beams of an imagined scan
_NEAR_M = 0.5  # what is farther from a path than the body reaches does not matter


@dataclass(frozen=True, slots=True)
class FloorMapConfig:
    cell_m: float = 0.025
    side_m: float = 64.0  # of the square that is kept, the start in its middle
    reach_m: float = 4.0  # of the scanner
    slack_m: float = 0.04  # a beam must go on by so much beyond a cell to call it free
    look_m: float = 3.0  # how far from a place unseen floor counts as to be seen from there
    most_tries: int = 6  # scans that should have shown a cell and did not: it cannot be seen
    window_m: float = 12.0  # ways are looked for at most so far from the robot, each way
    whole_m2: float = 600.0  # … unless all that is known is smaller than this

    def __post_init__(self) -> None:
        if not 0.01 <= self.cell_m <= 0.1 or not 5.0 <= self.side_m <= 100.0:
            raise ValueError("cell_m must be from 0.01 to 0.1 and side_m from 5 to 100")


@dataclass(frozen=True, slots=True, eq=False)
class BodyRoom:
    """`room_m` (rows, columns): how large a disc may stand at each cell. `frame` (3,): the odom position of the lower
    left corner, and the size of a cell."""

    room_m: NDArray[np.float64]
    frame: NDArray[np.float64]


class FloorMap:
    """One thread."""

    def __init__(self, car: CarGeometry, config: FloorMapConfig) -> None:
        self._config = config
        cells = 2 * round(config.side_m / config.cell_m / 2)
        self._low_m = -cells / 2 * config.cell_m
        self._evidence = np.zeros((cells, cells), np.int8)
        self._tries = np.zeros((cells, cells), np.uint8)
        self._marks = np.zeros((cells, cells), np.uint16)
        self._mark = 0
        self._body = lattice(-car.rear_m, car.front_m, car.width_m / 2, config.cell_m / 2)
        self._box = np.array([cells, 0, cells, 0], np.int64)  # rows and columns in which something may be known

    def clear(self) -> None:
        for grid in (self._evidence, self._tries):
            grid[self._rows, self._columns] = 0
        self._box = np.array([len(self._evidence), 0, len(self._evidence), 0], np.int64)

    @property
    def seen_m2(self) -> float:
        """Floor that is known to be free."""
        free = np.count_nonzero(self._evidence[self._rows, self._columns] < 0)
        return float(free) * self._config.cell_m**2

    def add_scan(self, ranges_m: NDArray[np.floating], geometry: ScanGeometry, odom_from_robot: Pose2) -> None:
        """Take a scan, (B,) with NaN where nothing was measured, made at this pose."""
        ranges = np.asarray(ranges_m, dtype=np.float64)
        scanner = (odom_from_robot @ geometry.robot_from_scanner).as_array()
        config = self._config
        self._widen(scanner)
        mark = self._new_marks(1)
        _kernels.unseen_in_sight(
            self._evidence,
            self._tries,
            config.most_tries,
            self._marks,
            mark,
            self._low_m,
            config.cell_m,
            scanner,
            geometry.first_angle_rad,
            geometry.step_rad,
            len(ranges),
            config.look_m,
        )
        _kernels.take_scan(
            self._evidence,
            self._low_m,
            config.cell_m,
            scanner,
            geometry.first_angle_rad,
            geometry.step_rad,
            geometry.range_min_m,
            config.reach_m,
            config.slack_m,
            ranges,
        )
        _kernels.stand_on(self._evidence, self._low_m, config.cell_m, odom_from_robot.apply(self._body))
        _kernels.count_tries(self._evidence, self._tries, self._marks, mark, self._box)

    def things_m(self, odom_from_robot: Pose2, reach_m: float) -> NDArray[np.float64]:
        """(N, 2): the middles of the cells in which something stands, near the robot."""
        cells, reach = self._config.cell_m, reach_m / self._config.cell_m
        column, row = (odom_from_robot.as_array()[:2] - self._low_m) / cells
        first_row, first_column = max(int(row - reach), 0), max(int(column - reach), 0)
        near = self._evidence[first_row : int(row + reach) + 1, first_column : int(column + reach) + 1]
        rows, columns = np.nonzero(near > 0)
        middles = np.column_stack((columns + first_column, rows + first_row)) + 0.5
        return np.asarray(middles * cells + self._low_m, np.float64)

    def views_m2(self, poses: NDArray[np.float64], geometry: ScanGeometry, beams: int) -> NDArray[np.float64]:
        """(M,): how much floor that was never seen a scan from each of `poses` (M, 3) would show."""
        scanner = geometry.robot_from_scanner
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = poses[:, 0] + c * scanner.x_m - s * scanner.y_m
        y = poses[:, 1] + s * scanner.x_m + c * scanner.y_m
        found = np.empty(len(poses), np.int64)
        _kernels.views(
            self._evidence,
            self._tries,
            self._config.most_tries,
            self._marks,
            self._new_marks(len(poses)),
            self._low_m,
            self._config.cell_m,
            np.column_stack((x, y, poses[:, 2] + scanner.theta_rad)),
            geometry.first_angle_rad,
            geometry.step_rad * _EVERY,
            beams // _EVERY,
            self._config.look_m,
            found,
        )
        return np.asarray(found * self._config.cell_m**2, np.float64)

    def room_for_body(self, odom_from_robot: Pose2, margin_m: float) -> BodyRoom:
        """Round the robot, or in all that is known where that is not much."""
        return self._room(self._window(odom_from_robot), margin_m)

    def room_along(self, path: NDArray[np.float64], margin_m: float) -> BodyRoom:
        """Near `path`, (N, 3)."""
        at = (path[:, [1, 0]] - self._low_m) / self._config.cell_m
        near = _NEAR_M / self._config.cell_m
        return self._room(self._clipped(np.floor(at.min(axis=0) - near), np.ceil(at.max(axis=0) + near)), margin_m)

    def _room(self, box: NDArray[np.int64], margin_m: float) -> BodyRoom:
        shape = (int(box[1] - box[0]), int(box[3] - box[2]))
        room_m = np.empty(shape)
        _kernels.room_for_body(self._evidence, box, self._config.cell_m, margin_m, room_m, np.empty(shape))
        return BodyRoom(room_m, self._frame(box))

    def _frame(self, box: NDArray[np.int64]) -> NDArray[np.float64]:
        cell = self._config.cell_m
        return np.array([self._low_m + box[2] * cell, self._low_m + box[0] * cell, cell])

    @property
    def _rows(self) -> slice:
        return slice(int(self._box[0]), max(int(self._box[0]), int(self._box[1])))

    @property
    def _columns(self) -> slice:
        return slice(int(self._box[2]), max(int(self._box[2]), int(self._box[3])))

    def _new_marks(self, count: int) -> int:
        """The first of so many that no cell bears."""
        if self._mark + count > np.iinfo(np.uint16).max:
            self._marks[self._rows, self._columns] = 0
            self._mark = 0
        self._mark += count
        return self._mark - count + 1

    def _widen(self, scanner: NDArray[np.float64]) -> None:
        """The scan's square belongs to what may be known."""
        cells, config = len(self._evidence), self._config
        reach = math.ceil(config.reach_m / config.cell_m) + 1
        column, row = np.floor((scanner[:2] - self._low_m) / config.cell_m).astype(int)
        box = self._box
        box[0], box[1] = min(box[0], max(row - reach, 0)), max(box[1], min(row + reach + 1, cells))
        box[2], box[3] = min(box[2], max(column - reach, 0)), max(box[3], min(column + reach + 1, cells))

    def _window(self, pose: Pose2) -> NDArray[np.int64]:
        """Rows and columns with a cell of border round what is known."""
        config = self._config
        known = self._evidence[self._rows, self._columns] != 0
        rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return np.array([0, 2, 0, 2], np.int64)
        low = self._box[[0, 2]] + (rows[0] - 1, columns[0] - 1)
        high = self._box[[0, 2]] + (rows[-1] + 2, columns[-1] + 2)
        if (high - low).prod() * config.cell_m**2 > config.whole_m2:
            at = np.floor((np.array([pose.y_m, pose.x_m]) - self._low_m) / config.cell_m)
            reach = config.window_m / config.cell_m
            low, high = np.maximum(low, at - reach), np.minimum(high, at + reach)
        return self._clipped(low, high)

    def _clipped(
        self, low: NDArray[np.floating | np.int64], high: NDArray[np.floating | np.int64]
    ) -> NDArray[np.int64]:
        """Rows and columns from row and column `low` to `high`, two at least, within the map."""
        cells = len(self._evidence)
        low = np.clip(low, 0, cells - 2)
        high = np.clip(high, low + 2, cells)
        return np.array([low[0], high[0], low[1], high[1]], np.int64)
