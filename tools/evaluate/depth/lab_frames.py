"""Depth frames of the simulated rooms, as the robot's camera sees them on its way round."""

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
# Through the four rooms of the flat, whose tables and chairs stand on legs.
_FLAT_VIEWS = (
    (1.60, 0.85, 0.0),
    (1.50, 2.60, -30.0),
    (1.30, 1.90, 0.0),
    (4.90, 0.90, 150.0),
    (6.20, 1.90, 0.0),
    (7.30, 1.20, 60.0),
    (2.40, 4.40, 180.0),
    (1.60, 4.50, 60.0),
    (5.10, 4.60, 0.0),
    (7.20, 4.90, -15.0),
    (8.20, 5.40, -60.0),
    (7.60, 4.40, 135.0),
)
VIEWS = {"lab": LAB_VIEWS, "lab-rearranged": LAB_VIEWS, "flat": _FLAT_VIEWS}


def lab_camera(scenario_name: str = "lab") -> tuple[Intrinsics, CameraMount]:
    """The camera that `lab_frames` sees with."""
    scenario = find_scenario(scenario_name)
    return camera_intrinsics(scenario.camera), camera_mount(scenario)


def lab_frames(seed: int = 1, scenario_name: str = "lab") -> list[DepthImage]:
    """One noisy frame for each of the VIEWS of a scenario."""
    scenario = find_scenario(scenario_name)
    world = World(scenario, seed)
    renderer = DepthRenderer(world.model, scenario.camera)
    sensor = DepthSensor(scenario.camera, seed)
    inverse_per_m = np.empty((scenario.camera.height, scenario.camera.width), np.float32)
    frames = []
    try:
        for index, (x_m, y_m, heading_deg) in enumerate(VIEWS[scenario_name]):
            world.place(Pose2(x_m, y_m, math.radians(heading_deg)))
            renderer.render(world.camera_state(), inverse_per_m)
            frames.append(sensor.image(inverse_per_m, index, world.time_s))
    finally:
        renderer.close()
    return frames
