"""The rolling 2D scanner: each beam is cast from where the scanner is when it looks there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import RawScan
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry
from tools.simulator._kernels import beam_directions, echoes
from tools.simulator.engine import mujoco
from tools.simulator.mailbox import Mailbox
from tools.simulator.mjcf import STEP_S
from tools.simulator.scenario import ScannerParameters
from tools.simulator.solids import solids_of
from tools.simulator.world import World

_STEPS_PER_TURN = 1024
_FIRST_STEP, _FRONT_STEP = 44, 384
_SEEN_GROUPS = np.array([1, 0, 0, 0, 0, 0], np.uint8)  # not the robot's
_FLOOR_REFLECTIVITY = 0.3
_QUANTUM_M = 0.001


def scan_geometry(parameters: ScannerParameters, scanner_x_m: float) -> ScanGeometry:
    return ScanGeometry(
        first_angle_rad=(_FIRST_STEP - _FRONT_STEP) * math.tau / _STEPS_PER_TURN,
        step_rad=math.tau / _STEPS_PER_TURN,
        beam_interval_s=parameters.period_s / _STEPS_PER_TURN,
        range_min_m=parameters.range_min_m,
        range_max_m=parameters.range_max_m,
        robot_from_scanner=Pose2(scanner_x_m, 0.0, 0.0),
    )


class RollingScanner:
    """Sweeps with the world and leaves a `RawScan` after the last beam of each turn."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._parameters = world.scenario.scanner
        self._random = world.random("scanner")
        self.geometry = scan_geometry(self._parameters, world.scenario.body.scanner_x_m)
        self.scans: Mailbox[RawScan] = Mailbox(world.moved)
        self._site = mujoco.mj_name2id(world.model, mujoco.mjtObj.mjOBJ_SITE, "scanner")
        self._reflectivity = _reflectivity_of_geoms(world)
        self._bias_phase_rad = float(self._random.uniform(0, math.tau))
        self._sweep_began_s = world.elapsed_s + float(self._random.uniform(0, self._parameters.period_s))
        self._next_beam = 0
        count = self._parameters.beams
        self._angles_rad = self.geometry.angles_rad(count)
        self._range_m = np.empty(count)
        self._signal = np.empty(count)
        self._beam_times_s = self.geometry.beam_interval_s * np.arange(count)
        self._nothing_m = 2 * self._parameters.range_max_m
        self._directions, self._normals = np.empty((count, 3)), np.empty((count, 3))
        self._hit_m, self._geom = np.empty(count), np.empty(count, np.int32)
        self._stamp_s = 0.0

    def after_step(self) -> None:
        """Cast the beams that were due during the step."""
        now_s = self._world.elapsed_s
        due = math.ceil((now_s - self._sweep_began_s) / self.geometry.beam_interval_s - 1e-9)
        last = min(due, self._parameters.beams)
        if last <= self._next_beam:
            return
        if self._next_beam == 0:
            self._stamp_s = self._world.clock_time_s(self._sweep_began_s)
        self._cast(self._next_beam, last, now_s - STEP_S)
        self._next_beam = last
        if last == self._parameters.beams:
            self._finish()

    def _cast(self, first: int, last: int, began_s: float) -> None:
        """Beams `first` to `last`, from the pose at the step's beginning moved on with its velocity."""
        data, count = self._world.data, last - first
        late_s = np.asarray(self._beam_times_s[first:last] + (self._sweep_began_s - began_s), np.float64)
        directions, normals = self._directions[:count], self._normals[:count]
        hit_m, geom = self._hit_m[:count], self._geom[:count]
        rotation = data.site_xmat[self._site]
        beam_directions(self._angles_rad[first:last], late_s, float(data.qvel[5]), rotation, directions)
        origin = data.site_xpos[self._site] + self._site_velocity_mps() * float(late_s[count // 2])
        mujoco.mj_multiRay(
            self._world.model, data, origin, directions.reshape(-1), _SEEN_GROUPS, True, -1,
            geom, hit_m, normals.reshape(-1), count, self._nothing_m,
        )  # fmt: skip
        echoes(
            directions, normals, hit_m, geom, self._reflectivity, self._nothing_m,
            self._range_m[first:last], self._signal[first:last],
        )  # fmt: skip

    def _site_velocity_mps(self) -> NDArray[np.float64]:
        """Of the scanner, which turns with the robot about its origin."""
        data = self._world.data
        lever_x, lever_y, _ = (data.site_xpos[self._site] - data.qpos[:3]).tolist()
        vx, vy, vz, _, _, yaw_rate = data.qvel[:6].tolist()
        return np.array([vx - yaw_rate * lever_y, vy + yaw_rate * lever_x, vz])

    def _finish(self) -> None:
        ranges_m = noisy_ranges(self._range_m, self._signal, self._parameters, self._bias_phase_rad, self._random)
        self.scans.put(RawScan(self._stamp_s, ranges_m))
        self._sweep_began_s += self._parameters.period_s
        self._next_beam = 0


def noisy_ranges(
    true_m: NDArray[np.float64],
    signal: NDArray[np.float64],
    parameters: ScannerParameters,
    bias_phase_rad: float,
    random: np.random.Generator,
) -> NDArray[np.float32]:
    """What the scanner reports for the true ranges (B,), in m, NaN where it reports nothing.

    `signal` (B,) is reflectivity times the cosine of the incidence. Beams at an edge meet two surfaces and report
    something in between or nothing; weak echoes get lost; the rest is Gaussian and rounded to a millimetre.
    """
    draws = random.random((4, len(true_m)))
    noise = random.standard_normal(len(true_m))
    step_m, partner_m = _nearest_edge(true_m)
    at_edge = step_m > parameters.edge_step_m
    mixed = at_edge & (draws[0] < parameters.edge_mixed)
    measured_m = np.where(mixed, true_m + draws[1] * (partner_m - true_m), true_m)
    sigma_m = parameters.sigma_m + parameters.sigma_fraction * measured_m
    bias_m = parameters.bias_m * np.sin(math.tau / parameters.bias_period_m * measured_m + bias_phase_rad)
    measured_m = np.round((measured_m + bias_m + sigma_m * noise) / _QUANTUM_M) * _QUANTUM_M
    weakness = 2 - signal / np.square(true_m) / parameters.min_signal_per_m2  # 0 at twice the minimum, 1 at it
    lost = (draws[2] < parameters.dropout) | (draws[3] < weakness)
    lost |= at_edge & (draws[0] > 1 - parameters.edge_lost)
    lost |= (measured_m < parameters.range_min_m) | (measured_m > parameters.range_max_m)
    return np.where(lost, np.nan, measured_m).astype(np.float32)


def _nearest_edge(true_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """For each beam the larger step to one of its neighbours, and that neighbour's range."""
    step_m = np.abs(np.diff(true_m))
    before, after = np.concatenate(([0.0], step_m)), np.concatenate((step_m, [0.0]))
    partner_m = np.where(before > after, np.roll(true_m, 1), np.roll(true_m, -1))
    return np.maximum(before, after), partner_m


def _reflectivity_of_geoms(world: World) -> NDArray[np.float64]:
    """(ngeom,) by geom number."""
    by_name = {solid.name: solid.reflectivity for solid in solids_of(world.scenario)}
    names = (mujoco.mj_id2name(world.model, mujoco.mjtObj.mjOBJ_GEOM, i) for i in range(world.model.ngeom))
    return np.array([by_name.get(name, _FLOOR_REFLECTIVITY) for name in names])
