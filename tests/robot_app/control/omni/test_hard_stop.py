from __future__ import annotations

import math
from collections import deque

import pytest

from robot_app.control.omni.hard_stop import HardStop, HardStopConfig
from shared.geometry.omni3 import OmniGeometry, Twist, Wheels

OMNI = OmniGeometry(0.13, 0.04, 0.17)
STEP_S, TICK, WINDOW = 0.001, 20, 30
STANDS: Wheels = (0.0, 0.0, 0.0)


class Body:
    """Three wheels with a third of the weight on each, on motors with a loss that is linear in their speed."""

    def __init__(self, twist: Twist, fades_s: float = 0.16, friction: float = 1.0) -> None:
        self.twist = twist
        self._fades_s = fades_s
        self._grip_mps2 = friction * 9.81 / 3  # of the whole mass
        self._rolled: deque[Wheels] = deque([OMNI.wheels_mps(twist)] * WINDOW, maxlen=WINDOW)

    def step(self, told: Wheels) -> None:
        """The floor pulls each wheel towards what its motor is told, as far as it holds."""
        true = OMNI.wheels_mps(self.twist)
        pulls, rolled = [], []
        for want, wheel in zip(told, true, strict=True):
            asked = (want - wheel) / (1.5 * self._fades_s)
            pulls.append(max(-self._grip_mps2, min(self._grip_mps2, asked)))
            rolled.append(wheel + 1.5 * self._fades_s * (asked - pulls[-1]))
        right, left, back = pulls
        x, y = math.sin(math.pi / 3) * (right - left), (right + left) / 2 - back
        turn = 1.4 * (right + left + back) / OMNI.wheel_distance_m / 2
        now = self.twist
        self.twist = Twist(now.x_mps + x * STEP_S, now.y_mps + y * STEP_S, now.turn_radps + turn * STEP_S)
        self._rolled.append((rolled[0], rolled[1], rolled[2]))

    @property
    def seen(self) -> Wheels:
        right, left, back = (sum(wheels) / WINDOW for wheels in zip(*self._rolled, strict=True))
        return right, left, back


def stopped(body: Body, is_known: bool, config: HardStopConfig | None = None) -> tuple[float, float]:
    """After how long it stands, and the speed that is left when nothing is pushed any more."""
    stop, told, ends_mps = HardStop(OMNI, config or HardStopConfig()), STANDS, math.nan
    stop.begin(0.0, body.seen)
    stands_s = 0.0
    for i in range(600):
        if i % TICK == 0:
            pushed = stop.step(i * STEP_S, body.seen if is_known else None)
            if pushed is None and math.isnan(ends_mps):
                ends_mps = body.twist.speed_mps
            told = pushed or STANDS
        body.step(told)
        if body.twist.speed_mps > 0.01 or abs(body.twist.turn_radps) > 0.08:
            stands_s = i * STEP_S
    return stands_s, ends_mps


WAYS = [Twist(0.42, 0.0, 0.0), Twist(-0.3, 0.0, 0.0), Twist(0.0, 0.3, 0.0), Twist(0.25, -0.15, 0.6), Twist(0, 0, 1.5)]


@pytest.mark.parametrize("twist", WAYS)
def test_it_stands_soon_whichever_way_it_went(twist: Twist) -> None:
    assert stopped(Body(twist), is_known=True)[0] < 0.19
    assert stopped(Body(twist), is_known=False)[0] < 0.22


@pytest.mark.parametrize("fades_s", [0.13, 0.19])
def test_the_encoders_correct_for_another_mass(fades_s: float) -> None:
    assert stopped(Body(WAYS[0], fades_s), is_known=True)[0] < 0.28
    assert stopped(Body(WAYS[0], fades_s), is_known=False)[1] < 0.10


def test_what_the_imu_feels_corrects_for_another_mass_too() -> None:
    def left_mps(witness: bool) -> float:
        body, stop, told = Body(WAYS[0], fades_s=0.20), HardStop(OMNI, HardStopConfig()), STANDS
        stop.begin(0.0, body.seen)
        for i in range(200):
            if i % TICK == 0:
                felt = OMNI.wheels_mps(body.twist) if witness else None
                pushed = stop.step(i * STEP_S, felt, are_felt=witness)
                if pushed is None:
                    break
                told = pushed
            body.step(told)
        return body.twist.speed_mps

    assert left_mps(witness=True) < 0.95 * left_mps(witness=False)


def test_on_a_slippery_floor_it_stops_as_the_floor_lets_it_and_is_not_sent_back() -> None:
    body = Body(WAYS[0], friction=0.4)
    assert stopped(body, is_known=True)[0] < 0.36  # 0.19 s at the edge of the grip
    assert body.twist.x_mps > -0.01


def test_its_push_stays_below_what_the_wheels_hold() -> None:
    stop = HardStop(OMNI, HardStopConfig())
    wheels = OMNI.wheels_mps(WAYS[0])
    stop.begin(0.0, wheels)
    told = stop.step(0.0, None)
    assert told is not None
    pulls = [(want - wheel) / (1.5 * 0.16) for want, wheel in zip(told, wheels, strict=True)]
    assert max(map(abs, pulls)) < 9.81 / 3


def test_who_stands_is_not_pushed_and_who_was_stopped_not_again() -> None:
    stop = HardStop(OMNI, HardStopConfig())
    assert stop.step(0.0, STANDS) is None
    stop.begin(1.0, STANDS)
    assert stop.step(1.0, None) is None
    stop.begin(2.0, (0.3, -0.3, 0.0))
    assert stop.step(2.0, (0.3, -0.3, 0.0)) is not None
    assert stop.step(3.0, (0.3, -0.3, 0.0)) is None
    assert stop.step(2.02, (0.3, -0.3, 0.0)) is None


def test_a_clock_that_goes_back_ends_it() -> None:
    stop = HardStop(OMNI, HardStopConfig())
    stop.begin(2.0, (0.3, -0.3, 0.0))
    assert stop.step(1.0, None) is None
