from __future__ import annotations

import pytest

from robot_app import schedule
from robot_app.drivers.base import TemperatureSample
from robot_app.vitals import VitalsMeter, brief
from shared.messages import FanState
from shared.protocol.codec import encode
from shared.runtime.runner import TaskHealth
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World


@pytest.fixture(scope="module")
def meter() -> VitalsMeter:
    return VitalsMeter(SimulatedHardware(World(find_scenario("lab"), 1), waits=False).hardware, 0.0)


def ticked(late: int) -> TaskHealth:
    health = TaskHealth(schedule.ODOMETRY)
    for i in range(200):
        health.began(0.012 if i < late else 0.001)
        health.finished(i * 0.01, 0.002)
    return health


def test_rates_and_shares_are_those_since_the_last_report(meter: VitalsMeter) -> None:
    health = ticked(late=4)
    first = meter.measure(2.0, [health], TemperatureSample(2.0, 50.0, ("under-voltage",), fan=True))
    assert (first.tasks[0].rate_hz, first.tasks[0].late_share) == (pytest.approx(100.0), pytest.approx(0.02))
    assert (first.fan, first.throttling) == (FanState.ON, ("under-voltage",))
    assert first.memory_mb > 10.0
    second = meter.measure(4.0, [health], None)
    assert (second.tasks[0].rate_hz, second.tasks[0].late_share) == (0.0, 0.0)
    assert (second.fan, second.tasks[0].latest_s) == (FanState.UNKNOWN, 0.012)


def test_over_lora_a_robot_that_is_well_takes_few_bytes(meter: VitalsMeter) -> None:
    rows = [TaskHealth(row) for row in schedule.TABLE]
    assert len(encode(brief(meter.measure(6.0, rows, None)))) < 25
    late = [*rows[1:], ticked(late=100)]
    assert [task.name for task in brief(meter.measure(8.0, late, None)).tasks] == ["odometry"]
