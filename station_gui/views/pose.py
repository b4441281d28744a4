"""Where the robot is on the map right now."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from station_gui.mapping.scan import to_points
from station_gui.model.view import OperatorView

DEFAULT_FOOTPRINT_M = ((-0.045, -0.10), (0.305, -0.10), (0.305, 0.10), (-0.045, 0.10))  # paper 1: 350 x 200 mm


def robot_on_map(view: OperatorView) -> Pose2 | None:
    """`map_from_robot` by the newest of snapshot and telemetry; None where nobody can tell, or it is not known.

    Telemetry comes oftener than the map changes and is carried over by `map_from_odom`.
    """
    snapshot = view.snapshot
    if snapshot is None or not snapshot.located:
        return None
    pose = snapshot.map_from_robot
    if view.telemetry is not None and view.telemetry.stamp_s > snapshot.stamp_s:
        pose = snapshot.map_from_odom @ view.telemetry.odom_from_robot
    return pose if is_finite(pose) else None


def is_finite(pose: Pose2) -> bool:
    return math.isfinite(pose.x_m) and math.isfinite(pose.y_m) and math.isfinite(pose.theta_rad)


def scan_on_map_m(view: OperatorView) -> NDArray[np.float64]:
    """(N, 2): what the newest scan hit, map frame; (0, 2) before there is a scan and a map, or a place in it."""
    observation, snapshot = view.observation, view.snapshot
    if observation is None or snapshot is None or not snapshot.located:
        return np.zeros((0, 2))
    if observation.stamp_s == snapshot.stamp_s:
        map_from_robot = snapshot.map_from_robot
    else:
        map_from_robot = snapshot.map_from_odom @ observation.odom_from_robot
    return finite_rows(map_from_robot.apply(to_points(observation).points_m))


def finite_rows(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """The rows of (N, ...) in which every number is finite."""
    rows = np.asarray(points, np.float64)
    return rows[np.isfinite(rows).all(axis=tuple(range(1, rows.ndim)))]


def footprint_m(view: OperatorView) -> NDArray[np.float64]:
    """(N, 2): the robot's corners, robot frame; the paper's robot until the robot has said otherwise."""
    corners = view.robot.footprint_m if view.robot is not None else ()
    known = finite_rows(np.array(corners, np.float64).reshape(-1, 2))
    return known if len(known) >= 3 else np.array(DEFAULT_FOOTPRINT_M)
