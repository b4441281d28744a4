from __future__ import annotations

import math

import numpy as np

from shared.geometry.rays import cast_rays
from shared.protocol.compact import tables
from shared.protocol.compact.casting import _kernels as casting
from shared.protocol.compact.state import UNITS_PER_RAD, Sweep
from tests.shared.samples import GEOMETRY

BEAMS = 227
ROOM = np.array([(-2.0, -1.5, 2.0, -1.5), (2.0, -1.5, 2.0, 1.5), (2.0, 1.5, -2.0, 1.5), (-2.0, 1.5, -2.0, -1.5)])


def rays_from(x_m: float, y_m: float, theta_rad: float) -> tuple[np.ndarray, np.ndarray]:
    sweep = Sweep.of(GEOMETRY)
    rays, motion = np.zeros((BEAMS, 4), np.int64), sweep.motion(0, 0)
    pose = np.array((round(x_m * 16_000), round(y_m * 16_000), round(theta_rad * UNITS_PER_RAD)), np.int64)
    casting.aim(pose, motion, sweep.mount, tables.SINE, rays)
    return rays, motion


def true_ranges(x_m: float, y_m: float, theta_rad: float) -> np.ndarray:
    mount_m = GEOMETRY.robot_from_scanner.x_m
    ranges = np.zeros(BEAMS)
    x_m, y_m = x_m + mount_m * math.cos(theta_rad), y_m + mount_m * math.sin(theta_rad)
    cast_rays(x_m, y_m, theta_rad + GEOMETRY.angles_rad(BEAMS), ROOM, 9.0, ranges)
    return ranges


def test_a_scan_predicts_the_next_one_to_a_millimetre() -> None:
    rays, motion = rays_from(0.0, 0.0, 0.0)
    stored, hits = np.zeros((BEAMS, 4), np.int64), np.zeros((BEAMS, 4), np.int64)
    casting.place(np.round(1e3 * true_ranges(0, 0, 0)).astype(np.int64), np.ones(BEAMS, np.int64), rays, stored)
    rays, _ = rays_from(0.05, -0.02, 0.08)
    casting.cast(stored, rays, motion, tables.ATAN, hits)
    off_m = hits[:, 0] / 16_000 - true_ranges(0.05, -0.02, 0.08)
    met = hits[:, 0] > 0
    assert met.mean() > 0.95
    assert np.percentile(np.abs(off_m[met]), 90) < 2e-3


def test_a_robot_that_moves_during_the_sweep_aims_from_where_it_is_then() -> None:
    sweep = Sweep.of(GEOMETRY)
    rays = np.zeros((BEAMS, 4), np.int64)
    casting.aim(np.zeros(3, np.int64), sweep.motion(200, 0), sweep.mount, tables.SINE, rays)  # 1 m/s
    passed_s = (BEAMS - 1) * GEOMETRY.beam_interval_s
    assert abs((rays[-1, 0] - rays[0, 0]) / 16_000 - passed_s) < 1e-3
    assert abs(rays[-1, 1]) < 16


def test_what_nothing_was_seen_in_stays_unknown() -> None:
    rays, motion = rays_from(0, 0, 0)
    hits = np.ones((BEAMS, 4), np.int64)
    casting.cast(np.zeros((BEAMS, 4), np.int64), rays, motion, tables.ATAN, hits)
    assert not hits[:, 0].any()
