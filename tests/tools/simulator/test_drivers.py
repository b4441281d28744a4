from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from robot_app.drivers.base import DeviceError, DriveSetting, Hardware
from shared.runtime.clock import MonotonicClock
from tools.simulator.drivers import RealTimePump, SimulatedHardware
from tools.simulator.faults import FaultKind, with_faults
from tools.simulator.scenario import Scenario, find_scenario
from tools.simulator.world import World

MakeRoom = Callable[..., Scenario]


@pytest.fixture
def lab() -> Iterator[tuple[World, Hardware]]:
    world = World(find_scenario("lab"), seed=1)
    hardware = SimulatedHardware(world, waits=False).hardware
    yield world, hardware
    hardware.close()


def samples_of_a_drive(seed: int) -> list[bytes]:
    world = World(find_scenario("lab"), seed)
    hardware = SimulatedHardware(world, waits=False).hardware
    hardware.drive.set(DriveSetting(0.5, 0.2))
    found = []
    for tick in range(1, 31):
        world.advance_to(tick * 0.01)
        if (scan := hardware.scanner.read(0.1)) is not None:
            found.append(np.float64(scan.stamp_s).tobytes() + scan.ranges_m.tobytes())
        samples = (hardware.imu.read(0.1), hardware.encoders.read(0.1), hardware.power.read(0.1))
        found += [repr(sample).encode() for sample in samples]
    image = hardware.camera.read(0.1)
    assert image is not None
    found.append(image.depth.tobytes())
    hardware.close()
    return found


def test_the_same_seed_gives_the_same_samples_bit_for_bit() -> None:
    assert samples_of_a_drive(1) == samples_of_a_drive(1)


def test_another_seed_gives_other_samples() -> None:
    assert samples_of_a_drive(1) != samples_of_a_drive(2)


def test_in_lock_step_a_read_answers_at_once_and_each_sample_comes_once(lab: tuple[World, Hardware]) -> None:
    world, hardware = lab
    assert hardware.scanner.read(100.0) is None
    world.advance_to(0.2)
    for device in (hardware.scanner, hardware.camera, hardware.imu, hardware.encoders, hardware.power):
        assert device.read(100.0) is not None
        assert device.read(100.0) is None


def test_the_scan_task_gets_every_scan_and_the_imu_task_every_sample(lab: tuple[World, Hardware]) -> None:
    world, hardware = lab
    scans = samples = 0
    for tick in range(1, 101):
        world.advance_to(tick * 0.01)
        samples += hardware.imu.read(0.0) is not None
        scans += tick % 4 == 0 and hardware.scanner.read(0.0) is not None
    assert scans >= 24
    assert samples == 100


def test_closing_twice_is_fine_and_reading_afterwards_names_the_device(lab: tuple[World, Hardware]) -> None:
    _, hardware = lab
    hardware.close()
    hardware.close()
    with pytest.raises(DeviceError, match="depth camera"):
        hardware.camera.read(0.0)
    with pytest.raises(DeviceError, match="scanner"):
        hardware.scanner.read(0.0)
    with pytest.raises(DeviceError, match="drive"):
        hardware.drive.set(DriveSetting(0.1, 0.0))
    hardware.drive.stop()


def test_in_real_time_reads_wait_for_their_sample() -> None:
    clock = MonotonicClock()
    world = World(find_scenario("lab"), seed=1)
    hardware = SimulatedHardware(world, waits=True).hardware
    pump = RealTimePump(world, clock)
    pump.start()
    try:
        scan, image = hardware.scanner.read(5.0), hardware.camera.read(5.0)
        imu, encoders = hardware.imu.read(5.0), hardware.encoders.read(5.0)
    finally:
        assert pump.stop()
        hardware.close()
    assert scan is not None
    assert image is not None
    assert imu is not None
    assert encoders is not None
    assert 0 <= scan.stamp_s <= clock.now_s()
    assert not any(thread.name == "simulator" for thread in threading.enumerate())


def test_a_wait_ends_when_nothing_comes(lab: tuple[World, Hardware]) -> None:
    world = World(find_scenario("lab"), seed=1)
    hardware = SimulatedHardware(world, waits=True).hardware
    assert hardware.scanner.read(0.01) is None
    hardware.close()


def test_the_camera_may_be_read_from_any_thread(lab: tuple[World, Hardware]) -> None:
    world, hardware = lab
    images = []
    for _ in range(2):
        world.advance_to(world.time_s + 0.1)
        thread = threading.Thread(target=lambda: images.append(hardware.camera.read(0.0)))
        thread.start()
        thread.join(10.0)
    assert all(image is not None and image.depth.any() for image in images)


def test_an_unplugged_device_raises_a_silent_one_says_nothing_and_both_come_back(lab: tuple[World, Hardware]) -> None:
    world, inner = lab
    hardware, faults = with_faults(inner)
    faults.scanner.kind = FaultKind.UNPLUGGED
    faults.imu.kind = FaultKind.SILENT
    world.advance_to(0.2)
    with pytest.raises(DeviceError, match="scanner: is unplugged"):
        hardware.scanner.read(0.0)
    assert hardware.imu.read(0.0) is None
    faults.scanner.kind = faults.imu.kind = FaultKind.NONE
    world.advance_to(0.4)
    assert hardware.scanner.read(0.0) is not None
    assert hardware.imu.read(0.0) is not None
    assert hardware.scanner.geometry == inner.scanner.geometry
    assert hardware.camera.intrinsics == inner.camera.intrinsics


def test_an_unplugged_drive_stops_the_car_and_stop_never_raises(lab: tuple[World, Hardware]) -> None:
    world, inner = lab
    hardware, faults = with_faults(inner)
    hardware.drive.set(DriveSetting(0.6, 0.0))
    world.advance_to(0.8)
    faults.drive.kind = FaultKind.UNPLUGGED
    with pytest.raises(DeviceError, match="drive: is unplugged"):
        hardware.drive.set(DriveSetting(0.6, 0.0))
    hardware.drive.stop()
    world.advance_to(1.4)
    assert abs(world.speed_mps()) < 0.01


def test_a_setting_that_is_no_number_is_refused(lab: tuple[World, Hardware]) -> None:
    with pytest.raises(DeviceError, match="cannot apply"):
        lab[1].drive.set(DriveSetting(float("nan"), 0.0))
