from __future__ import annotations

import threading
from collections import deque

import pytest

from robot_app.drivers.base import DeviceError, DriveSetting, Setting
from robot_app.safety.motors import HardBrake, Motors

STEP_S, TICK = 0.001, 20


class FakeDrive:
    def __init__(self) -> None:
        self.duties: list[float] = []
        self.is_gone = False

    def set(self, setting: Setting) -> Setting:
        assert isinstance(setting, DriveSetting)
        if self.is_gone:
            raise DeviceError("drive: is unplugged")
        self.duties.append(setting.duty)
        return setting

    def stop(self) -> None:
        self.duties.append(0.0)

    def close(self) -> None:
        pass


def pushing(duty: float) -> DriveSetting:
    return DriveSetting(duty, 0.1)


@pytest.fixture
def drive() -> FakeDrive:
    return FakeDrive()


@pytest.fixture
def motors(drive: FakeDrive) -> Motors:
    return Motors(drive, HardBrake(pushing), lambda: None)


@pytest.mark.parametrize("is_known", [True, False])
@pytest.mark.parametrize("fades_s", [0.05, 0.09, 0.12, 0.2])
def test_hard_braking_takes_most_of_the_speed_and_sends_no_car_back_by_two_centimetres(
    fades_s: float, is_known: bool
) -> None:
    """`fades_s`: of the speed of the car with its motor cut; the wheels' speed is measured over 0.1 s."""
    brake, speed_mps, duty, back_m = HardBrake(pushing), 0.46, 0.0, 0.0
    ways_m = deque([0.46 * STEP_S] * 100, maxlen=100)
    brake.begin(0.0, speed_mps)
    for i in range(300):
        if i % TICK == 0:
            duty = brake.duty(i * STEP_S, sum(ways_m) / 0.1 if is_known else None)
        speed_mps += (0.7 * duty - speed_mps) / fades_s * STEP_S
        ways_m.append(speed_mps * STEP_S)
        back_m -= min(0.0, speed_mps) * STEP_S
    assert back_m < 0.02
    assert abs(speed_mps) < 0.07
    assert brake.duty(0.3, None) == 0.0


def test_a_car_that_stands_is_not_pushed(motors: Motors, drive: FakeDrive) -> None:
    motors.set(DriveSetting(0.3, 0.1))
    motors.brake(0.0, 0.0, True)
    motors.brake(0.02, 0.0, False)
    assert drive.duties[1:] == [0.0, 0.0]
    assert motors.applied is None


def test_braking_begins_with_the_last_setting_and_not_again(motors: Motors, drive: FakeDrive) -> None:
    motors.set(DriveSetting(0.3, 0.1))
    for i in range(20):
        motors.brake(0.02 * i, 0.2, False)
    assert drive.duties[1] == pytest.approx(-0.34)
    assert drive.duties[-1] == 0.0


def test_a_speed_that_only_the_caller_knows_is_braked_from(motors: Motors, drive: FakeDrive) -> None:
    motors.brake(0.0, 0.0, False, before_mps=0.2)
    assert drive.duties == [pytest.approx(-0.34)]


def test_a_drive_that_is_gone_is_at_least_told_to_stop(motors: Motors, drive: FakeDrive) -> None:
    motors.set(DriveSetting(0.3, 0.1))
    drive.is_gone = True
    motors.brake(0.0, 0.2, True)
    assert drive.duties[1:] == [0.0]


def test_a_drive_that_is_gone_stays_a_fault_while_the_car_stands(motors: Motors, drive: FakeDrive) -> None:
    motors.brake(0.0, 0.0, True)
    motors.check()
    drive.is_gone = True
    with pytest.raises(DeviceError, match="unplugged"):
        motors.check()


def test_what_is_cut_is_not_pushed_any_more(motors: Motors, drive: FakeDrive) -> None:
    motors.set(DriveSetting(0.3, 0.1))
    motors.brake(0.0, 0.2, True)
    motors.cut()
    motors.brake(0.02, 0.2, True)
    assert drive.duties[2:] == [0.0, 0.0]


def test_a_thread_that_hangs_in_the_drive_keeps_nobody_from_stopping_it(motors: Motors, drive: FakeDrive) -> None:
    entered, leave = threading.Event(), threading.Event()

    def hang(duty: float) -> Setting:
        entered.set()
        leave.wait(10.0)
        return DriveSetting(duty, 0.0)

    motors._brake = HardBrake(hang)
    thread = threading.Thread(target=lambda: motors.brake(0.0, 0.0, False, before_mps=0.2))
    thread.start()
    assert entered.wait(10.0)
    motors.cut()
    assert drive.duties == [0.0]
    leave.set()
    thread.join()
