from __future__ import annotations

import math

import numpy as np

from shared.messages import MissionState, StopReason
from shared.runtime.clock import ManualClock
from station_gui.model.journal import Journal
from station_gui.model.telemetry_keeper import TelemetryKeeper
from tests.shared import samples
from tools.fuzz.room_drive import drive


def keeper() -> tuple[TelemetryKeeper, Journal]:
    journal = Journal(ManualClock())
    return TelemetryKeeper(journal), journal


def test_a_pulse_renews_what_it_says_and_leaves_the_rest() -> None:
    kept, _ = keeper()
    kept.take(samples.telemetry(stamp_s=1.0, late_ticks=3, battery_v=6.6), 10.0)
    kept.take(samples.pulse(stamp_s=2.0, battery_v=6.4), 11.0)
    telemetry = kept.telemetry
    assert telemetry is not None
    assert (telemetry.battery_v, telemetry.late_ticks, telemetry.stamp_s) == (6.4, 3, 2.0)
    assert telemetry.faults == ("camera: lost",)
    assert kept.age_s(11.5) == 0.5


def test_a_pulse_alone_is_telemetry_too() -> None:
    kept, _ = keeper()
    kept.take(samples.pulse(stamp_s=2.0), 0.0)
    assert kept.telemetry is not None
    assert math.isnan(kept.telemetry.yaw_rate_radps)


def test_observations_move_the_gauges_between_pulses(rng: np.random.Generator) -> None:
    kept, _ = keeper()
    kept.take(samples.telemetry(stamp_s=-1.0), 0.0)
    observation = drive(3, rng)[2]
    kept.take_motion(observation, 0.5)
    assert kept.telemetry is not None
    assert kept.telemetry.speed_mps == observation.speed_mps
    assert kept.telemetry.odom_from_robot == observation.odom_from_robot
    assert kept.age_s(0.5) == 0.0


def test_a_report_that_another_has_overtaken_changes_nothing() -> None:
    kept, journal = keeper()
    kept.take(samples.telemetry(stamp_s=2.0, state=MissionState.COMMAND), 0.0)
    kept.take(samples.pulse(stamp_s=1.5, state=MissionState.OBSERVE), 0.1)
    assert kept.telemetry is not None
    assert kept.telemetry.state is MissionState.COMMAND
    told = [e.text for e in journal.since(0)]
    assert told == ["mission: command", "robot: camera: lost"]


def test_a_fault_that_a_pulse_has_overtaken_is_told() -> None:
    kept, journal = keeper()
    kept.take(samples.telemetry(stamp_s=1.0, state=MissionState.OBSERVE, faults=()), 0.0)
    kept.take(samples.pulse(stamp_s=3.0, state=MissionState.COMMAND), 0.1)
    for _ in range(2):
        kept.take(samples.telemetry(stamp_s=2.0, state=MissionState.OBSERVE, faults=("camera: lost",)), 0.2)
    kept.take(samples.telemetry(stamp_s=1.5, state=MissionState.OBSERVE, faults=("imu: lost",)), 0.3)
    assert kept.telemetry is not None
    assert (kept.telemetry.state, kept.telemetry.stamp_s) == (MissionState.COMMAND, 3.0)
    assert kept.telemetry.faults == ("camera: lost",)
    assert [e.text for e in journal.since(0)] == ["mission: observe", "mission: command", "robot: camera: lost"]


def test_a_robot_that_began_anew_is_believed_although_its_clock_went_back() -> None:
    kept, journal = keeper()
    kept.take(samples.telemetry(stamp_s=300.0, faults=()), 0.0)
    kept.take(samples.telemetry(stamp_s=1.0, state=MissionState.HALTED, stop_reason=StopReason.SHUTDOWN), 0.1)
    assert journal.since(0)[-2].text == "mission: halted, stopped: shutdown"
