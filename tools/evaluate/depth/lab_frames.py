"""Depth frames of the simulated lab, as the robot's camera sees it on its way round."""

from __future__ import annotations

import math

import numpy as np

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import CameraMount, Intrinsics
from shared.geometry.se2 import Pose2
from tools.simulator.depth_camera import DepthRenderer, DepthSensor, camera_intrinsics, camera_mount
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World

# x (m), y (m), heading (degrees), room frame: once round the lane with the wall at the right, and a look back.
LAB_VIEWS = (
    (1.30, 0.97, 0.0),
    (2.20, 0.97, 0.0),
    (2.90, 1.05, 45.0),
    (3.00, 1.60, 90.0),
    (3.00, 2.40, 90.0),
    (2.90, 3.10, 135.0),
    (2.20, 3.20, 180.0),
    (1.40, 3.20, 180.0),
    (0.95, 3.00, -120.0),
    (0.90, 2.20, -90.0),
    (0.95, 1.20, -45.0),
    (1.80, 0.97, 180.0),
)


def lab_camera(scenario_name: str = "lab") -> tuple[Intrinsics, CameraMount]:
    """The camera that `lab_frames` sees with."""
    scenario = find_scenario(scenario_name)
    return camera_intrinsics(scenario.camera), camera_mount(scenario)


def lab_frames(seed: int = 1, scenario_name: str = "lab") -> list[DepthImage]:
    """One noisy frame for each of LAB_VIEWS."""
    scenario = find_scenario(scenario_name)
    world = World(scenario, seed)
    renderer = DepthRenderer(world.model, scenario.camera)
    sensor = DepthSensor(scenario.camera, seed)
    inverse_per_m = np.empty((scenario.camera.height, scenario.camera.width), np.float32)
    frames = []
    try:
        for index, (x_m, y_m, heading_deg) in enumerate(LAB_VIEWS):
            world.place(Pose2(x_m, y_m, math.radians(heading_deg)))
            renderer.render(world.camera_state(), inverse_per_m)
            frames.append(sensor.image(inverse_per_m, index, world.time_s))
    finally:
        renderer.close()
    return frames
