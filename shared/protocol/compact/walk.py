"""An observation, value by value: the same walk writes it and reads it, so that the two cannot differ."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shared.geometry.se2 import Pose2
from shared.messages import ObjectNetwork, Observation, ScanGeometry
from shared.protocol.compact import tables
from shared.protocol.compact.casting import _kernels as casting
from shared.protocol.compact.correction import HEADING_UNIT as HEADING_STEP
from shared.protocol.compact.correction import corrected, rotated
from shared.protocol.compact.model import Coding
from shared.protocol.compact.objects.walk import NetworkChoice, code_objects
from shared.protocol.compact.scan import _kernels as scanning
from shared.protocol.compact.state import HEADING_UNIT, MOST_BEAMS, VIEWS, State, Sweep, Unfit

IntArray = NDArray[np.int64]

_BOOT, _GEOMETRY, _SEQUENCE, _STAMP, _SPEED, _TURN_RATE, _X, _Y, _HEADING, _STEP, _LEVEL = range(11)
_HAS_OBJECTS = 11  # 12 to 22 are the objects'
_SHIFT_X, _SHIFT_Y, _SHIFT_HEADING = 24, 25, 26
_KEY_DISTANCE = 1_600  # 10 cm
_KEY_TURN = 16_700  # 0.1 rad
_MOST_SCANS_IN_MEAN = 6
_FURTHEST = 1 << 30  # mm
_GEOMETRY_FORMAT = struct.Struct("<8f")


class Choice(Protocol):
    """What the encoder wants to say; the decoder has none."""

    boot_id: int
    geometry: ScanGeometry
    sequence: int
    stamp_ms: int
    odom: tuple[int, int, int]
    speed: int
    turn_rate: int
    step_mm: int
    level: int
    ranges_mm: IntArray

    @property
    def slack_mm(self) -> int: ...

    def correction(self, state: State, pose: IntArray, motion: IntArray, sweep: Sweep) -> tuple[int, int, int]: ...

    def shown(self, expected_mm: IntArray) -> IntArray: ...

    def network(self, state: State) -> NetworkChoice | None: ...


@dataclass(slots=True)
class Sizes:
    """Bytes so far, after each part."""

    pose: int = 0
    alignment: int = 0  # the scan's, to the last one
    scan: int = 0
    objects: int = 0


def code_observation(coding: Coding, state: State, choice: Choice | None) -> tuple[Observation, int, Sizes]:
    """Write what `choice` holds, or read it, against `state`, which is brought up to date.

    Gives the observation as the other side has it and how much detail was left out. Raises `Unfit` for foreign values.
    """
    sizes = Sizes()
    sweep = _code_head(coding, state, choice)
    was = state.odom
    _code_pose(coding, state, choice)
    sizes.pose = coding.bytes_so_far
    motion = sweep.motion(state.speed, state.turn_rate)
    turned = _code_correction(coding, state, choice, was, motion, sweep)
    sizes.alignment = coding.bytes_so_far
    ranges_mm = _code_scan(coding, state, choice, turned, motion, sweep)
    sizes.scan = coding.bytes_so_far
    network = code_objects(coding, state, choice.network(state) if choice else None)
    level = coding.number(choice.level if choice else 0, _LEVEL, 4)
    sizes.objects = coding.bytes_so_far
    state.number += 1
    state.seal()
    return _observation(state, ranges_mm, network), level, sizes


def _code_head(coding: Coding, state: State, choice: Choice | None) -> Sweep:
    if coding.number(int(choice is not None and choice.boot_id != state.boot_id), _BOOT, 1):
        state.boot_id = coding.raw(choice.boot_id if choice else 0, 32)
    new_geometry = choice is not None and (
        choice.geometry != state.geometry or len(choice.ranges_mm) != len(state.before_mm)
    )
    if coding.number(int(new_geometry), _GEOMETRY, 1):
        _code_geometry(coding, state, choice)
    expected = state.sequence + 1
    sequence = expected + coding.number(choice.sequence - expected if choice else 0, _SEQUENCE, 34)
    earlier, last = state.intervals_ms
    at_ms = state.stamp_ms + earlier
    stamp_ms = at_ms + coding.number(choice.stamp_ms - at_ms if choice else 0, _STAMP, 38)
    if not 0 <= sequence < 1 << 32 or not abs(stamp_ms) < 1 << 36:
        raise Unfit("a number of none")
    state.intervals_ms = (last, min(10_000, max(0, stamp_ms - state.stamp_ms)))
    state.sequence, state.stamp_ms = sequence, stamp_ms
    return Sweep.of(state.geometry)


def _code_geometry(coding: Coding, state: State, choice: Choice | None) -> None:
    """Once in a session: as it is, and all that was seen from another scanner is forgotten."""
    packed = bytes(_GEOMETRY_FORMAT.size)
    if choice is not None:
        g, mount = choice.geometry, choice.geometry.robot_from_scanner
        packed = _GEOMETRY_FORMAT.pack(
            g.first_angle_rad, g.step_rad, g.beam_interval_s, g.range_min_m, g.range_max_m,
            mount.x_m, mount.y_m, mount.theta_rad,
        )  # fmt: skip
    values = _GEOMETRY_FORMAT.unpack(bytes(coding.raw(byte, 8) for byte in packed))
    beams = coding.raw(len(choice.ranges_mm) if choice else 0, 12)
    if not all(map(math.isfinite, values)) or beams > MOST_BEAMS:
        raise Unfit("a geometry that is none")
    state.geometry = _geometry(values)
    state.scans = np.zeros((VIEWS, beams, 4), np.int64)
    state.before_mm = np.zeros(beams, np.int64)


def _geometry(values: tuple[float, ...]) -> ScanGeometry:
    first, step, interval, least, most, x, y, theta = values
    return ScanGeometry(first, step, interval, least, most, Pose2(x, y, theta))


def _code_pose(coding: Coding, state: State, choice: Choice | None) -> None:
    """Speeds against the last ones, the pose against where they lead."""
    speed, turn_rate = state.speed, state.turn_rate
    state.speed += coding.number(choice.speed - speed if choice else 0, _SPEED, 13)
    state.turn_rate += coding.number(choice.turn_rate - turn_rate if choice else 0, _TURN_RATE, 13)
    if abs(state.speed) > 4_000 or abs(state.turn_rate) > 4_000:
        raise Unfit("a speed of none")
    x, y, heading = _ahead(state, speed + state.speed, turn_rate + state.turn_rate)
    moving = min(3, abs(state.speed) // 8)
    x += coding.number(choice.odom[0] - x if choice else 0, _X, 31, moving)
    y += coding.number(choice.odom[1] - y if choice else 0, _Y, 31, moving)
    off = (choice.odom[2] - heading + 4096) % 8192 - 4096 if choice else 0
    heading += coding.number(off, _HEADING, 13, min(3, abs(state.turn_rate) // 32))
    if max(abs(x), abs(y)) > _FURTHEST:
        raise Unfit("a pose of none")
    state.odom = (x, y, heading % (tables.TURN // HEADING_UNIT))


def _ahead(state: State, twice_speed: int, twice_turn_rate: int) -> tuple[int, int, int]:
    """The pose that the mean of two speeds leads to, in the units of `state.odom`."""
    x, y, heading = state.odom
    passed_ms = state.intervals_ms[1]
    turned = twice_turn_rate * 256 * passed_ms // 1000
    along = heading * HEADING_UNIT + turned // 2
    way_um = twice_speed * 5 * passed_ms // 2
    x += (way_um * int(casting.sine(along + tables.TURN // 4, tables.SINE)) // 1000 + (1 << 19)) >> 20
    y += (way_um * int(casting.sine(along, tables.SINE)) // 1000 + (1 << 19)) >> 20
    return x, y, heading + (turned + HEADING_UNIT // 2) // HEADING_UNIT


def _code_correction(
    coding: Coding, state: State, choice: Choice | None, was: tuple[int, int, int], motion: IntArray, sweep: Sweep
) -> int:
    """Move `state.here` by odometry and by what brings the scan nearer to the last one; how far it turned."""
    turned = (state.odom[2] - was[2]) * HEADING_UNIT
    dx, dy = rotated(
        16 * (state.odom[0] - was[0]), 16 * (state.odom[1] - was[1]), state.here[2] - was[2] * HEADING_UNIT
    )
    x, y, heading = state.here[0] + dx, state.here[1] + dy, state.here[2] + turned
    wanted = (0, 0, 0)
    if choice is not None:
        wanted = choice.correction(state, np.array((x, y, heading), np.int64), motion, sweep)
    correction = (
        coding.number(wanted[0], _SHIFT_X, 8),
        coding.number(wanted[1], _SHIFT_Y, 8),
        coding.number(wanted[2], _SHIFT_HEADING, 8),
    )
    state.here = corrected((x, y, heading), correction)
    if max(abs(state.here[0]), abs(state.here[1])) > 32 * _FURTHEST:
        raise Unfit("a pose of none")
    return turned + correction[2] * HEADING_STEP


def _code_scan(
    coding: Coding, state: State, choice: Choice | None, turned: int, motion: IntArray, sweep: Sweep
) -> IntArray:
    beams = len(state.before_mm)
    state.step_mm += coding.number(choice.step_mm - state.step_mm if choice else 0, _STEP, 8)
    if not 1 <= state.step_mm <= 255:
        raise Unfit("a step of none")
    rays, hits = np.zeros((beams, 4), np.int64), np.zeros((beams, 4), np.int64)
    views, decoded = np.zeros((beams, 8), np.int64), np.zeros((beams, 3), np.int64)
    pose = np.array(state.here, np.int64)
    casting.aim(pose, motion, sweep.mount, tables.SINE, rays)
    casting.look(state.scans, rays, motion, tables.ATAN, hits, views)
    shift = -((2 * turned * 4096 + sweep.step) // (2 * sweep.step))
    ranges_mm = choice.shown(views[:, 0]) if choice is not None else np.zeros(beams, np.int64)
    scanning.code_scan(
        coding.coder, coding.data, ranges_mm, state.step_mm, choice.slack_mm if choice else 0,
        views, state.before_mm, shift, *coding.arrays, decoded,
    )  # fmt: skip
    _remember(state, decoded, rays)
    return decoded[:, 0].copy()


def _remember(state: State, decoded: IntArray, rays: IntArray) -> None:
    """The scan takes the place of the last one, which is set aside once the robot is somewhere else."""
    beams = len(decoded)
    settled, counts = np.zeros(beams, np.int64), np.zeros(beams, np.int64)
    casting.settle(decoded, state.step_mm, _MOST_SCANS_IN_MEAN, settled, counts)
    x, y, heading = state.here
    turned = abs((heading - state.key[2] + tables.TURN // 2) % tables.TURN - tables.TURN // 2)
    far = (x - state.key[0]) ** 2 + (y - state.key[1]) ** 2 > _KEY_DISTANCE**2
    if state.number > 0 and (far or turned > _KEY_TURN):
        state.scans[1:] = state.scans[:-1].copy()
        state.key = state.here
    casting.place(settled, counts, rays, state.scans[0])
    state.before_mm[:] = decoded[:, 0]


def _observation(state: State, ranges_mm: IntArray, network: ObjectNetwork | None) -> Observation:
    ranges_m = np.where(ranges_mm > 0, ranges_mm * 1e-3, np.nan).astype(np.float32)
    ranges_m.setflags(write=False)
    return Observation(
        sequence=state.sequence,
        stamp_s=state.stamp_ms * 1e-3,
        odom_from_robot=state.odom_from_robot,
        speed_mps=state.speed * 5e-3,
        yaw_rate_radps=state.turn_rate * 512 / tables.TURN * math.tau,
        geometry=state.geometry,
        ranges_m=ranges_m,
        objects=network if network is not None else ObjectNetwork(),
        has_objects=network is not None,
        boot_id=state.boot_id,
    )
