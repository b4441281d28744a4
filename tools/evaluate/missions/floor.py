"""How much of the floor a mission has seen.

Floor is what no thing covers at the height of the scanner, in cells of 5 cm. Reachable is the floor that a beam of
the scanner passes from any pose to which the robot can drive from its start with 5 cm to spare on all sides
(`goals.reachable`, tried out exhaustively in the true room). Seen is what the beams passed from the true poses of the
mission. Both use the same beams: the scanner's field of view, its longest range, and every second step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from shared.geometry.ackermann import CarGeometry
from shared.geometry.omni3 import OmniGeometry
from shared.geometry.se2 import Pose2
from tools.evaluate.goals.reachable import reach_of
from tools.evaluate.missions import _kernels
from tools.simulator.scenario import Scenario
from tools.simulator.solids import solids_of

CELL_M = 0.05
_MARGIN_M = 0.05
_EVERY_BEAM = 2
_TURN_STEPS = 1024
_PLACE_M = 0.12  # between the poses looked from
_HEADINGS = 12
_SCAN_EVERY = 5  # truth is kept at 50 Hz

Bools = NDArray[np.bool_]


class Floor:
    """The reachable floor of one room."""

    def __init__(self, scenario: Scenario, body: CarGeometry | OmniGeometry) -> None:
        self._scenario = scenario
        self._segments = _outlines_m(scenario)
        self.reach = reach_of(scenario, body, scenario.start.room_from_robot, _MARGIN_M)
        self.reachable = self._look(thinned(self.reach.poses_m(), _PLACE_M, _HEADINGS))

    def seen(self, poses: NDArray[np.float64]) -> Bools:
        """(rows, columns): the floor seen from `poses`, (N, 4) as of `Track.poses`."""
        return self._look(poses[::_SCAN_EVERY, 1:4])

    def share_seen(self, poses: NDArray[np.float64]) -> float:
        return float((self.seen(poses) & self.reachable).sum() / self.reachable.sum())

    def _look(self, poses: NDArray[np.float64]) -> Bools:
        """`poses`: (N, 3) of the robot, room frame."""
        scanner, body, room = self._scenario.scanner, self._scenario.body, self._scenario.room
        beams = np.arange(0, scanner.beams, _EVERY_BEAM) - (scanner.beams - 1) / 2
        eye = Pose2(body.scanner_x_m, 0.0, 0.0)
        scanners = np.array([(Pose2(*pose) @ eye).as_array() for pose in poses.tolist()]).reshape(-1, 3)
        seen = np.zeros((math.ceil(room.width_y_m / CELL_M), math.ceil(room.length_x_m / CELL_M)), bool)
        _kernels.look(
            scanners,
            beams * math.tau / _TURN_STEPS,
            self._segments,
            scanner.range_max_m,
            CELL_M,
            np.empty(len(beams)),
            np.empty(len(beams)),
            seen,
        )
        return seen


def _outlines_m(scenario: Scenario) -> NDArray[np.float64]:
    """(S, 4): all faces at the height of the scanner; also where things touch, or beams would get in between them."""
    outlines = [solid.corners_m() for solid in solids_of(scenario) if solid.reaches(scenario.body.scanner_z_m)]
    return np.concatenate([np.hstack((corners, np.roll(corners, -1, axis=0))) for corners in outlines])


def thinned(poses: NDArray[np.float64], place_m: float, headings: int) -> NDArray[np.float64]:
    """One of the poses (N, 3) for each square of `place_m` and each of so many headings."""
    turn = np.floor(np.mod(poses[:, 2], math.tau) / math.tau * headings)
    keys = np.column_stack((np.floor(poses[:, :2] / place_m), turn)).astype(np.int64)
    _, first = np.unique(keys, axis=0, return_index=True)
    return poses[np.sort(first)]
