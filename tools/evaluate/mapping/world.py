"""The true world for the evaluation of 3D maps: boxes, the distances to them, and what the camera can have seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.evaluate.mapping._kernels import nearest_surface, seen_by_camera
from tools.simulator.scenario import Scenario
from tools.simulator.solids import Solid, item_solids, solids_of, wall_solids

FloatArray = NDArray[np.float64]

_BEYOND_M = 1.0  # how far what nobody can see of walls and below the floor is thought to go on
_POSE_EVERY_M = 0.05
_POSE_EVERY_RAD = 0.09


@dataclass(frozen=True, slots=True, eq=False)
class TrueWorld:
    """`boxes`: (B, 8) as the kernels take them; `item`: (B,) index into the scenario's items, -1 for walls."""

    scenario: Scenario
    boxes: FloatArray
    item: NDArray[np.int64]

    def signed_distance_m(self, points_m: FloatArray) -> FloatArray:
        """(N,): of points (N, 3), room frame, to the nearest surface; negative inside of things. The floor is none."""
        return self._nearest(points_m)[0]

    def nearest_item(self, points_m: FloatArray) -> NDArray[np.int64]:
        """(N,): the item with the nearest surface, -1 for a wall."""
        return self.item[self._nearest(points_m)[1]]

    def corner_lines_m(self) -> FloatArray:
        """(E, 2, 3): the four upright edges of everything, room frame, whether they can be seen or not."""
        lines = []
        for solid in solids_of(self.scenario):
            low_m, high_m = solid.center_m[2] - solid.half_m[2], solid.center_m[2] + solid.half_m[2]
            lines += [[(x, y, low_m), (x, y, high_m)] for x, y in solid.corners_m().tolist()]
        return np.array(lines)

    def edge_lines_m(self) -> FloatArray:
        """(E, 2, 3): all twelve edges of every box, room frame."""
        around = ((0, 1), (1, 2), (2, 3), (3, 0))
        upright_m = self.corner_lines_m().reshape(-1, 4, 2, 3)  # of each box, one corner after the other
        level_m = [upright_m[:, (a, b), end] for end in range(2) for a, b in around]
        return np.concatenate((upright_m.reshape(-1, 2, 3), *level_m))

    def _nearest(self, points_m: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        distance_m, nearest = np.empty(len(points_m)), np.zeros(len(points_m), np.int64)
        nearest_surface(np.ascontiguousarray(points_m), self.boxes, distance_m, nearest)
        return distance_m, nearest

    def seen(self, points_m: FloatArray, cameras: FloatArray) -> NDArray[np.bool_]:
        """(N,): which of the points (N, 3) any of the `cameras` of `camera_places` sees."""
        camera = self.scenario.camera
        across, up = (math.tan(math.radians(angle / 2)) for angle in (camera.horizontal_deg, camera.vertical_deg))
        lens = np.array([across, up, camera.range_min_m, camera.range_max_m])
        seen = np.zeros(len(points_m), np.bool_)
        seen_by_camera(np.ascontiguousarray(points_m), cameras, lens, self.boxes, seen)
        return seen


def true_world(scenario: Scenario) -> TrueWorld:
    walls = [_thickened(wall, scenario) for wall in wall_solids(scenario.room)]
    solids = [(k, solid) for k, item in enumerate(scenario.items) for solid in item_solids(item)]
    boxes = np.array([_row(solid) for solid in (*walls, *(solid for _, solid in solids))])
    numbers = [k if scenario.items[k].kind != "wall" else -1 for k, _ in solids]
    return TrueWorld(scenario, boxes, np.array([-1] * len(walls) + numbers, np.int64))


def camera_places(scenario: Scenario, poses: FloatArray) -> FloatArray:
    """(V, 5): x, y, z, heading and pitch of the camera every few centimetres and degrees of the way.

    `poses`: (N, 4) time_s, x_m, y_m, theta_rad of the robot, room frame.
    """
    moved = np.hypot(*np.diff(poses[:, 1:3], axis=0).T) / _POSE_EVERY_M
    turned = np.abs((np.diff(poses[:, 3]) + math.pi) % math.tau - math.pi) / _POSE_EVERY_RAD
    steps = np.floor(np.concatenate(([0.0], np.cumsum(moved + turned))))
    taken = poses[np.unique(steps, return_index=True)[1]]
    car, theta = scenario.car, taken[:, 3]
    x_m = taken[:, 1] + car.camera_x_m * np.cos(theta)
    y_m = taken[:, 2] + car.camera_x_m * np.sin(theta)
    pitch = np.full(len(taken), math.radians(car.camera_pitch_down_deg))
    return np.column_stack((x_m, y_m, np.full(len(taken), car.camera_z_m), theta, pitch))


def _row(solid: Solid) -> tuple[float, ...]:
    (x, y, z), (half_x, half_y, half_z) = solid.center_m, solid.half_m
    if z - half_z < 1e-3:  # what stands on the floor has no face below
        z, half_z = z - _BEYOND_M / 2, half_z + _BEYOND_M / 2
    return x, y, z, half_x, half_y, half_z, math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)


def _thickened(wall: Solid, scenario: Scenario) -> Solid:
    """With its outer face, which nobody sees, far out."""
    middle = np.array([scenario.room.length_x_m / 2, scenario.room.width_y_m / 2])
    away = np.array(wall.center_m[:2]) - middle
    axis = int(np.argmin(wall.half_m[:2]))
    center, half = list(wall.center_m), list(wall.half_m)
    center[axis] += math.copysign(_BEYOND_M / 2, away[axis])
    half[axis] += _BEYOND_M / 2
    return Solid(
        wall.name, (center[0], center[1], center[2]), (half[0], half[1], half[2]), wall.yaw_rad, wall.reflectivity
    )
