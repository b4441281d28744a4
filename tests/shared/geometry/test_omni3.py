from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.geometry.omni3 import WHEEL_ANGLES_RAD, OmniGeometry, Twist

OMNI = OmniGeometry(wheel_distance_m=0.13, wheel_radius_m=0.04, radius_m=0.17)
speeds = st.floats(-1, 1)
twists = st.builds(Twist, speeds, speeds, st.floats(-3, 3))


@given(twists)
def test_a_motion_comes_back_from_its_wheels(twist: Twist) -> None:
    back = OMNI.twist(OMNI.wheels_mps(twist))
    assert (back.x_mps, back.y_mps, back.turn_radps) == pytest.approx(
        (twist.x_mps, twist.y_mps, twist.turn_radps), abs=1e-12
    )


@given(twists)
def test_a_wheel_rolls_as_its_place_on_the_body_moves_along_it(twist: Twist) -> None:
    """The velocity of the wheel's foot on its own direction of rolling: an independent way to equation 1."""
    for angle, rolls in zip(WHEEL_ANGLES_RAD, OMNI.wheels_mps(twist), strict=True):
        foot = 0.13 * np.array([math.cos(angle), math.sin(angle)])
        velocity = np.array([twist.x_mps, twist.y_mps]) + twist.turn_radps * np.array([-foot[1], foot[0]])
        along = np.array([-math.sin(angle), math.cos(angle)])
        assert rolls == pytest.approx(float(velocity @ along), abs=1e-12)


@given(st.floats(-4, 4), speeds, speeds, st.floats(-3, 3))
def test_equation_3_is_equations_1_and_2(heading: float, x_mps: float, y_mps: float, turn_radps: float) -> None:
    """As the paper writes the matrix of equation 3, with alpha = 120 degrees."""
    half, length = math.radians(60), 0.13
    matrix = np.array(
        [
            [math.sin(half - heading), math.cos(half - heading), length],
            [-math.sin(half + heading), math.cos(half + heading), length],
            [math.sin(heading), -math.cos(heading), length],
        ]
    )
    wheels = OMNI.wheels_in_room_mps(heading, x_mps, y_mps, turn_radps)
    assert wheels == pytest.approx(tuple((matrix @ (x_mps, y_mps, turn_radps)).tolist()), abs=1e-12)


def test_the_footprint_holds_the_disc_and_little_more() -> None:
    corners = np.array(OMNI.footprint_m())
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    assert np.hypot(*middles.T) == pytest.approx(0.17)
    assert np.hypot(*corners.T).max() < 0.174
    area = 0.5 * np.sum(corners[:, 0] * np.roll(corners[:, 1], -1) - np.roll(corners[:, 0], -1) * corners[:, 1])
    assert area > 0  # counter-clockwise


@pytest.mark.parametrize("sizes", [(0.0, 0.04, 0.17), (0.13, -0.04, 0.17), (0.13, 0.04, 0.12)])
def test_impossible_sizes_are_refused(sizes: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=r"_m must be"):
        OmniGeometry(*sizes)
