"""A drive through a room of four walls and a pillar, seen by a scanner with noise, as observations."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from shared.geometry.rays import cast_rays
from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry

_WALLS = np.array(
    [
        (-2.0, -1.5, 2.0, -1.5), (2.0, -1.5, 2.0, 1.5), (2.0, 1.5, -2.0, 1.5), (-2.0, 1.5, -2.0, -1.5),
        (0.6, 0.7, 1.0, 0.7), (1.0, 0.7, 1.0, 1.0), (1.0, 1.0, 0.6, 1.0), (0.6, 1.0, 0.6, 0.7),
    ]
)  # fmt: skip
_BOX = np.array([(x, y, z) for z in (0.0, 0.4) for x, y in ((0.6, 0.7), (1.0, 0.7), (1.0, 1.0), (0.6, 1.0))])
_BOX_EDGES = [(i, (i + 1) % 4) for i in range(4)] + [(i + 4, (i + 1) % 4 + 4) for i in range(4)]
_BOX_EDGES += [(i, i + 4) for i in range(4)]
BEAMS = 227
_GEOMETRY = ScanGeometry(-2.08, 3 * math.tau / 1024, 3 * 0.04 / 1024, 0.06, 4.0, Pose2(0.25, 0.0, 0.0))


def drive(count: int, rng: np.random.Generator, noise_m: float = 0.005, nodes: bool = True) -> list[Observation]:
    """Observations 0.1 s apart, round a circle at 0.3 m/s, whole millimetres."""
    return [_observed(k, rng, noise_m, nodes) for k in range(count)]


def _observed(k: int, rng: np.random.Generator, noise_m: float, nodes: bool) -> Observation:
    turn = 0.03 * k
    odom_from_robot = Pose2(math.sin(turn), 1.0 - math.cos(turn) - 1.0, math.remainder(turn, math.tau))
    scanner = odom_from_robot @ _GEOMETRY.robot_from_scanner
    ranges = np.zeros(BEAMS)
    directions = scanner.theta_rad + _GEOMETRY.angles_rad(BEAMS)
    cast_rays(scanner.x_m, scanner.y_m, directions, _WALLS, 3.0, ranges)
    ranges = np.round((ranges + noise_m * rng.standard_normal(BEAMS)) * 1e3) / 1e3
    ranges[rng.random(BEAMS) < 0.02] = np.nan
    network = ObjectNetwork()
    if nodes:
        seen = odom_from_robot.inverse().apply_3d(_BOX + 0.002 * rng.standard_normal(_BOX.shape))
        network = ObjectNetwork(seen.astype(np.float32), np.array(_BOX_EDGES, np.uint16))
    return Observation(
        k, 5.0 + 0.1 * k, odom_from_robot, 0.3, 0.3, _GEOMETRY, ranges.astype(np.float32), network, nodes, boot_id=77
    )


def endless(observations: list[Observation]) -> Iterator[Observation]:
    """Over and over, numbered on."""
    for sequence, observation in enumerate(itertools.cycle(observations)):
        yield replace(observation, sequence=sequence)
