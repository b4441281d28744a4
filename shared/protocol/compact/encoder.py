"""Observations to datagrams, predicted from what the other side is known to have.

A datagram is a byte (bit 7: keyframe; bits 6 to 3: its number modulo 16; bits 2 to 0: how many numbers back lies the
state that it is predicted from, less one), a check over the bytes and over the state that comes of them, and the coded
values, without zeros at their end. The check has 24 bits; 8 where the link lets in nobody else's bytes and no damage,
and it has to tell only that the two sides have come to differ.
"""

from __future__ import annotations

import math
import zlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared.messages import Observation, ScanGeometry
from shared.protocol.compact.fitting.fit import best_correction
from shared.protocol.compact.model import Coding
from shared.protocol.compact.objects.match import choose
from shared.protocol.compact.objects.walk import MOST_NEW, NetworkChoice
from shared.protocol.compact.state import (
    HEADING_UNIT,
    MOST_BEAMS,
    SPEED_UNIT_MM,
    TURN_RATE_UNIT,
    UNITS_PER_RAD,
    State,
    Sweep,
    Unfit,
)
from shared.protocol.compact.walk import Sizes, code_observation

IntArray = NDArray[np.int64]

CHECK_BYTES = 3
NUMBERS = 16
WINDOW = 8  # states that are kept on either side
KEYFRAME = 0x80
_LARGEST_BYTES = 131_072
_WHOLE_STEP_MM = 21  # whole millimetres: at most 10 mm off
_STEP_MM = 20
_FAR_MM = 65_000


@dataclass(frozen=True, slots=True)
class Detail:
    """What may be left out to meet a budget: new nodes and beams that nothing is known of, beyond a number of them;
    differences from the expected ranges up to `slack_mm`. What was left out follows with the next observations.
    """

    new_nodes: int = MOST_NEW
    new_beams: int = MOST_BEAMS
    slack_mm: int = 0


DETAILS = (
    Detail(),
    Detail(12),
    Detail(4),
    Detail(1),
    Detail(0),
    Detail(0, 64),
    Detail(0, 32),
    Detail(0, 16, 21),
    Detail(0, 8, 42),
    Detail(0, 4, 84),
)


def check_of(payload: bytes, state: State, check_bytes: int) -> bytes:
    """Of the bytes and of what came of them."""
    return zlib.crc32(state.digest.to_bytes(4, "little"), zlib.crc32(payload)).to_bytes(4, "little")[:check_bytes]


@dataclass(slots=True, eq=False)
class _Sending:
    """An observation in the units of the wire, and how it is to be said."""

    boot_id: int
    geometry: ScanGeometry
    sequence: int
    stamp_ms: int
    odom: tuple[int, int, int]
    speed: int
    turn_rate: int
    step_mm: int
    ranges_mm: IntArray
    observation: Observation
    level: int = 0  # of `DETAILS`
    shift: tuple[int, int, int] | None = None

    @staticmethod
    def of(observation: Observation) -> _Sending:
        millimetres = 1e3 * np.nan_to_num(observation.ranges_m.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
        whole = np.clip(np.round(millimetres), 0, _FAR_MM).astype(np.int64)
        pose = observation.odom_from_robot
        heading = round(pose.theta_rad * UNITS_PER_RAD / HEADING_UNIT) % (2**20 // HEADING_UNIT)
        return _Sending(
            boot_id=observation.boot_id,
            geometry=_as_sent(observation.geometry),
            sequence=observation.sequence,
            stamp_ms=round(observation.stamp_s * 1e3),
            odom=(round(pose.x_m * 1e3), round(pose.y_m * 1e3), heading),
            speed=round(observation.speed_mps * 1e3 / SPEED_UNIT_MM),
            turn_rate=round(observation.yaw_rate_radps * UNITS_PER_RAD / TURN_RATE_UNIT),
            step_mm=_WHOLE_STEP_MM if np.abs(millimetres - whole).max(initial=0) < 0.01 else _STEP_MM - 1,
            ranges_mm=whole,
            observation=observation,
        )

    def correction(self, state: State, pose: IntArray, motion: IntArray, sweep: Sweep) -> tuple[int, int, int]:
        if self.shift is None:
            if state.number == 0 or not (state.scans[0, :, 2] > 0).any():
                self.shift = (0, 0, 0)
            else:
                self.shift = best_correction(state.scans[0], pose, motion, sweep.mount, self.ranges_mm, self.step_mm)
        return self.shift

    @property
    def slack_mm(self) -> int:
        return DETAILS[self.level].slack_mm

    def shown(self, expected_mm: IntArray) -> IntArray:
        """The ranges without those that are one too many of which nothing is known."""
        new = (expected_mm == 0) & (self.ranges_mm > 0)
        return np.where(new & (np.cumsum(new) > DETAILS[self.level].new_beams), 0, self.ranges_mm)

    def network(self, state: State) -> NetworkChoice | None:
        if not self.observation.has_objects:
            return None
        choice, complete = choose(self.observation.objects, state, DETAILS[self.level].new_nodes)
        self.level = max(self.level, int(not complete))
        return choice


def _as_sent(geometry: ScanGeometry) -> ScanGeometry:
    """With the numbers that 32-bit floats have."""

    def single(value: float) -> float:
        return float(np.float32(value))

    mount = geometry.robot_from_scanner
    return ScanGeometry(
        single(geometry.first_angle_rad),
        single(geometry.step_rad),
        single(geometry.beam_interval_s),
        single(geometry.range_min_m),
        single(geometry.range_max_m),
        replace(mount, x_m=single(mount.x_m), y_m=single(mount.y_m), theta_rad=single(mount.theta_rad)),
    )


@dataclass(frozen=True, slots=True)
class Encoded:
    datagram: bytes
    number: int  # of the state that it leads to, modulo 16
    keyframe: bool
    level: int  # of `DETAILS`: 0 when everything is said
    sizes: Sizes


class Encoder:
    """One session's sending side.

    `in_order`: the link delivers everything once and in order, or `reset` is called: each observation is predicted
    from the one before. Without it each is predicted from the newest that `acknowledge` has heard of.
    """

    def __init__(
        self, in_order: bool = False, initial: Callable[[], State] = State.initial, check_bytes: int = CHECK_BYTES
    ) -> None:
        """`initial`: what both sides know before a keyframe. `check_bytes`: as the decoder has it."""
        self._in_order = in_order
        self._check_bytes = check_bytes
        self._initial = initial
        self._number = 0
        self._sent: OrderedDict[int, State] = OrderedDict()
        self._base: int | None = None

    @property
    def newest(self) -> State | None:
        """What the other side knows once it has the last datagram."""
        return self._sent[next(reversed(self._sent))] if self._sent else None

    def reset(self) -> None:
        """The other side may have nothing: begin with a keyframe."""
        self._sent.clear()
        self._base = None

    def acknowledge(self, feedback: bytes) -> None:
        """What the decoder's `feedback` said; foreign or outdated bytes change nothing."""
        if len(feedback) != 3 or feedback[0] > 0x1F:
            return
        number, digest = feedback[0] & 0x0F, int.from_bytes(feedback[1:], "little")
        if feedback[0] & 0x10:
            self.reset()
        elif not self._in_order and number in self._sent and self._sent[number].digest & 0xFFFF == digest:
            newer = self._base is None or (number - self._base) % NUMBERS < NUMBERS // 2
            self._base = number if newer else self._base

    def encode(self, observation: Observation, max_bytes: int | None = None) -> Encoded:
        """The datagram of an observation; above `max_bytes` detail is left out, as far as it can be.

        Raises `ValueError` for an observation that this profile cannot carry.
        """
        pose = observation.odom_from_robot
        numbers = (observation.stamp_s, *pose.as_array(), observation.speed_mps, observation.yaw_rate_radps)
        if len(observation.ranges_m) > MOST_BEAMS or not all(map(math.isfinite, numbers)):
            raise ValueError(f"{len(observation.ranges_m)} beams at {observation.stamp_s} s and {pose}")
        sending = _Sending.of(observation)
        encoded, state = self._attempt(sending, 0)
        if max_bytes is not None and len(encoded.datagram) > max_bytes:
            encoded, state = self._with_less(sending, max_bytes)
        self._keep(encoded.number, state)
        return encoded

    def _with_less(self, sending: _Sending, max_bytes: int) -> tuple[Encoded, State]:
        """By halving, four attempts at most: each level says less than the one before, but for a few bits."""
        low, high = 1, len(DETAILS) - 1
        found: tuple[Encoded, State] | None = None
        while low < high:
            middle = (low + high) // 2
            tried = self._attempt(sending, middle)
            if len(tried[0].datagram) <= max_bytes:
                found, high = tried, middle
            else:
                low = middle + 1
        return found or self._attempt(sending, low)

    def _attempt(self, sending: _Sending, level: int) -> tuple[Encoded, State]:
        base = self._base_state()
        state = base.copy() if base is not None else self._initial()
        sending.level = level
        coding = Coding(state.model, np.zeros(_LARGEST_BYTES, np.uint8), _LARGEST_BYTES, reading=False)
        try:
            _, _, sizes = code_observation(coding, state, sending)
        except Unfit as error:
            raise ValueError(str(error)) from error
        payload = coding.finish()
        head = KEYFRAME | self._number << 3 if base is None else self._number << 3 | self._distance()
        check = check_of(bytes((head,)) + payload, state, self._check_bytes)
        datagram = bytes((head,)) + check + payload
        return Encoded(datagram, self._number, base is None, sending.level, sizes), state

    def _distance(self) -> int:
        return (self._number - 1 - (self._base or 0)) % NUMBERS

    def _base_state(self) -> State | None:
        if self._base is None or self._base not in self._sent or self._distance() >= WINDOW:
            return None
        return self._sent[self._base]

    def _keep(self, number: int, state: State) -> None:
        self._sent[number] = state
        self._sent.move_to_end(number)
        while len(self._sent) > WINDOW:
            oldest = next(key for key in self._sent if key != self._base or len(self._sent) <= 1)
            del self._sent[oldest]
        self._number = (number + 1) % NUMBERS
        if self._in_order:
            self._base = number
