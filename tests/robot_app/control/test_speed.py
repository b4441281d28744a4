import pytest

from robot_app.control.speed import SpeedConfig, SpeedController


def _drive(controller: SpeedController, target_mps: float, seconds: float, full_duty_mps: float = 0.62) -> float:
    """The speed of a motor with a lag of 0.12 s after some seconds."""
    speed = 0.0
    for k in range(round(seconds * 100)):
        duty = controller.step(k * 0.01, target_mps, speed)
        speed += 0.01 / 0.12 * (full_duty_mps * duty - speed)
    return speed


@pytest.mark.parametrize("target_mps", [0.05, 0.2, 0.4, -0.15])
def test_the_wanted_speed_is_reached_with_a_motor_weaker_than_assumed(target_mps: float) -> None:
    assert _drive(SpeedController(SpeedConfig()), target_mps, 3.0) == pytest.approx(target_mps, abs=0.005)


def test_a_standing_car_that_is_to_stand_gets_no_duty_at_all() -> None:
    controller = SpeedController(SpeedConfig())
    assert [controller.step(k * 0.01, 0.0, 0.004) for k in range(20)] == [0.0] * 20


def test_the_duty_never_leaves_the_bridges_range() -> None:
    controller = SpeedController(SpeedConfig())
    duties = [controller.step(k * 0.01, 5.0, 0.0) for k in range(500)]
    assert max(duties) == 1.0
    assert min(controller.step(5.0 + k * 0.01, -5.0, 0.5) for k in range(800)) == -1.0


def test_a_stalled_motor_winds_nothing_up_beyond_the_bound() -> None:
    controller = SpeedController(SpeedConfig())
    for k in range(1000):
        controller.step(k * 0.01, 0.2, 0.0)
    assert controller.step(10.01, 0.2, 0.2) < 0.9


def test_the_first_step_does_not_jump() -> None:
    assert SpeedController(SpeedConfig()).step(100.0, 0.4, 0.0) == 0.0
