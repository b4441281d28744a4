"""Puts the newest scan and the newest objects together as one observation."""

from __future__ import annotations

import numpy as np

from robot_app.drivers.base import RawScan
from robot_app.sensing.odometry import Odometry
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from shared.runtime.latest import Stamped


def observe(
    sequence: int,
    scan: RawScan,
    geometry: ScanGeometry,
    objects: Stamped[ObjectNetwork] | None,
    odometry: Odometry,
    boot_id: int,
) -> Observation | None:
    """The observation at the scan's stamp; None when the odometry does not reach back to it.

    The depth image was taken at another moment; its nodes are moved to where they are seen from at the scan's.
    """
    state = odometry.at(scan.stamp_s)
    if state is None:
        return None
    seen = odometry.at(objects.stamp_s) if objects is not None else None
    network = ObjectNetwork()
    if objects is not None and seen is not None:
        robot_from_then = state.odom_from_robot.inverse() @ seen.odom_from_robot
        network = _moved(objects.value, robot_from_then)
    return Observation(
        sequence=sequence,
        stamp_s=scan.stamp_s,
        odom_from_robot=state.odom_from_robot,
        speed_mps=state.speed_mps,
        yaw_rate_radps=state.yaw_rate_radps,
        geometry=geometry,
        ranges_m=scan.ranges_m,
        objects=network,
        has_objects=seen is not None,
        boot_id=boot_id,
    )


def _moved(objects: ObjectNetwork, robot_from_then: Pose2) -> ObjectNetwork:
    return ObjectNetwork(robot_from_then.apply_3d(objects.nodes_m).astype(np.float32), objects.edges)
