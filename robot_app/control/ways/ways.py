"""All ways of the car among what it has seen, and the path along one of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_app.control.ground.floor_map import BodyRoom
from robot_app.control.ways import _kernels
from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2

_DISCS = 4
_CHECKS = 3  # for room, in each of the finest steps


@dataclass(frozen=True, slots=True)
class WaysConfig:
    step_m: float = 0.12
    cell_m: float = 0.05
    headings: int = 32
    most_nodes: int = 150_000  # enough for the ways of about 3 m in an open hall
    reverse_cost: float = 1.5  # of a metre in reverse, in metres forward
    cusp_cost_m: float = 0.35  # of a change of direction
    steering_cost_m: float = 0.05  # of a change from full right to full left
    tight_cost: float = 1.0  # of a metre without room to spare
    turning_reserve: float = 1.06  # circles are this much wider than the car's smallest
    spacing_m: float = 0.04


def body_discs(car: CarGeometry) -> NDArray[np.float64]:
    """(D + 1,): the radius of the discs that cover the body, and their centres ahead of the rear axle."""
    part = (car.front_m + car.rear_m) / _DISCS
    centres = -car.rear_m + part * (np.arange(_DISCS) + 0.5)
    return np.array([math.hypot(part / 2, car.width_m / 2), *centres])


class WaysBuffers:
    """What a search works in, kept between searches: where memory is locked, getting it anew holds everyone up."""

    def __init__(self, config: WaysConfig) -> None:
        most = config.most_nodes
        self.nodes, self.parents = np.empty((most, 5)), np.empty(most, np.int64)
        self.keys, self.items = np.empty(most), np.empty(most, np.int64)
        self.best = np.empty(2**20, np.float32)

    def widen(self, states: int) -> None:
        """There are as many states as the window has; it is bounded by the floor map."""
        if states > len(self.best):
            self.best = np.empty(2 ** math.ceil(math.log2(states)), np.float32)


class Ways:
    """Of the car from one pose; good until the buffers are used again."""

    def __init__(
        self,
        car: CarGeometry,
        config: WaysConfig,
        room: BodyRoom,
        start: Pose2,
        direction: float,
        buffers: WaysBuffers,
        grain: int = 1,
    ) -> None:
        """`direction`: in which the car moves now; 0 where it stands. `grain`: so many times as coarse as finest."""
        self._config = config
        self._step_m, cell_m, headings = config.step_m * grain, config.cell_m * grain, config.headings // grain
        rows, columns = (int(cells * float(room.frame[2]) / cell_m) + 1 for cells in room.room_m.shape)
        self._curvature = 1.0 / (car.min_turning_radius_m * config.turning_reserve)
        buffers.widen(rows * columns * headings)
        nodes, parents = buffers.nodes, buffers.parents
        count = _kernels.find_ways(
            room.room_m,
            room.frame,
            body_discs(car),
            np.array([*start.as_array(), direction]),
            self._curvature,
            self._step_m,
            cell_m,
            headings,
            _CHECKS * grain,
            np.array([config.reverse_cost, config.cusp_cost_m, config.steering_cost_m, config.tight_cost]),
            buffers.best,
            nodes,
            parents,
            buffers.keys,
            buffers.items,
        )
        self.are_all = count < config.most_nodes  # rather than the nearest
        self.poses = nodes[:count, :3]
        self.costs_m = nodes[:count, 3]
        self._moves = nodes[:count, 4].astype(np.int64)
        self._parents = parents[:count]

    def __len__(self) -> int:
        return len(self.poses)

    def spread(self, place_m: float, headings: int) -> NDArray[np.int64]:
        """One node, the cheapest, for each square of `place_m` and each of so many headings; the cheapest first."""
        turn = np.floor(np.mod(self.poses[:, 2], math.tau) / math.tau * headings)
        keys = np.column_stack((np.floor(self.poses[:, :2] / place_m), turn)).astype(np.int64)
        keys -= keys.min(axis=0)
        sizes = keys.max(axis=0) + 1
        flat = (keys[:, 0] * sizes[1] + keys[:, 1]) * sizes[2] + keys[:, 2]
        order = np.argsort(self.costs_m, kind="stable")
        _, first = np.unique(flat[order], return_index=True)
        return order[np.sort(first)]

    def nearest_to(self, pose: Pose2, reach_m: float, turn_rad: float) -> int | None:
        """The cheapest node within reach of a pose, turned no further from it than that."""
        off = np.hypot(self.poses[:, 0] - pose.x_m, self.poses[:, 1] - pose.y_m)
        turned = np.abs(np.mod(self.poses[:, 2] - pose.theta_rad + math.pi, math.tau) - math.pi)
        near = np.flatnonzero((off <= reach_m) & (turned <= turn_rad))
        if not len(near):
            return None
        return int(near[np.argmin(self.costs_m[near] + 2.0 * off[near])])

    def path_to(self, node: int) -> NDArray[np.float64]:
        """(N, 3) from the start, a point at most every `spacing_m`."""
        chain = []
        while node > 0:
            chain.append(node)
            node = int(self._parents[node])
        points = [self.poses[0]]
        parts = max(1, math.ceil(self._step_m / self._config.spacing_m))
        for k in reversed(chain):
            points += self._along(self.poses[self._parents[k]], int(self._moves[k]), parts)
        return np.array(points)

    def _along(self, pose: NDArray[np.float64], move: int, parts: int) -> list[NDArray[np.float64]]:
        step = (self._step_m if move < 5 else -self._step_m) / parts
        bend = self._curvature * 0.5 * (move % 5 - 2)
        x, y, theta = pose.tolist()
        points = []
        for _ in range(parts):
            x += step * math.cos(theta + 0.5 * step * bend)
            y += step * math.sin(theta + 0.5 * step * bend)
            theta += step * bend
            points.append(np.array([x, y, theta]))
        return points


def path_room_m(car: CarGeometry, room: BodyRoom, path: NDArray[np.float64]) -> float:
    """The least room of the body along a path, (N, 3); negative where it does not fit."""
    return float(_kernels.worst_room(room.room_m, room.frame, body_discs(car), np.ascontiguousarray(path)))
