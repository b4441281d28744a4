"""Messages to test with."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from shared.geometry.se2 import Pose2
from shared.messages import (
    Ack,
    Drive,
    EmergencyStop,
    FanState,
    GoTo,
    Heartbeat,
    Hello,
    KeyframeWanted,
    Message,
    MissionState,
    NumberedCommand,
    ObjectNetwork,
    Observation,
    Pause,
    Pulse,
    Refusal,
    Resume,
    ReturnToStart,
    ScanGeometry,
    Start,
    Stop,
    StopReason,
    TaskVitals,
    Telemetry,
    Vitals,
)

GEOMETRY = ScanGeometry(-2.08, 3 * math.tau / 1024, 3 * 0.04 / 1024, 0.06, 4.0, Pose2(0.25, 0.0, 0.0))


def observation(rng: np.random.Generator, sequence: int = 7, beams: int = 227, nodes: int = 60) -> Observation:
    ranges = rng.uniform(0.1, 4.0, beams).astype(np.float32)
    ranges[rng.random(beams) < 0.2] = np.nan
    edges = rng.integers(0, nodes, (nodes, 2)).astype(np.uint16) if nodes else np.zeros((0, 2), np.uint16)
    network = ObjectNetwork(rng.uniform(-3, 3, (nodes, 3)).astype(np.float32), edges)
    return Observation(
        sequence, 12.5 + sequence / 10, Pose2(1.0, -2.0, 0.5), 0.21, -0.3, GEOMETRY, ranges, network, nodes > 0
    )


def telemetry(**changes: object) -> Telemetry:
    values: dict[str, object] = {
        "stamp_s": 3.25,
        "state": MissionState.OBSERVE,
        "stop_reason": StopReason.NONE,
        "odom_from_robot": Pose2(0.5, 0.25, -1.0),
        "speed_mps": 0.2,
        "yaw_rate_radps": 0.1,
        "steering_rad": -0.25,
        "battery_v": 6.61,
        "motor_current_a": 0.8,
        "cpu_temperature_c": 51.5,
        "distance_m": 4.5,
        "late_ticks": 3,
        "following_goal": 0,
        "faults": ("camera: lost",),
    }
    return Telemetry(**(values | changes))  # type: ignore[arg-type]


def pulse(**changes: object) -> Pulse:
    t = telemetry(**changes)
    names = [f.name for f in dataclasses.fields(Pulse)]
    return Pulse(**{name: getattr(t, name) for name in names})


def vitals(**changes: object) -> Vitals:
    values: dict[str, object] = {
        "stamp_s": 3.25,
        "cores": 0.31,
        "memory_mb": 221.5,
        "fan": FanState.ON,
        "throttling": ("under-voltage",),
        "tasks": (TaskVitals("odometry", 100.0, 0.0021, 0.0, 0.0132, 0.0004),),
        "counters": (("lost edges", 2),),
    }
    return Vitals(**(values | changes))  # type: ignore[arg-type]


def every_message(rng: np.random.Generator) -> list[Message]:
    path = rng.uniform(-40, 40, (30, 3)).astype(np.float32)
    commands = (
        Start(),
        Stop(),
        EmergencyStop(),
        GoTo(3, path),
        Drive(-0.1, 0.4),
        Heartbeat(),
        ReturnToStart(),
        Pause(),
        Resume(),
    )
    corners = ((0.3, -0.1), (0.3, 0.1), (-0.04, 0.1))
    reports: list[Message] = [
        observation(rng),
        observation(rng, beams=0, nodes=0),
        telemetry(),
        Hello("車 one", "0.1.0", corners, 0.476),
        Ack(9, False, "go to is possible once the observation has finished"),
        Refusal("another station is connected"),
        pulse(battery_v=6.6, cpu_temperature_c=51.0),
        KeyframeWanted(),
        vitals(),
    ]
    return reports + [NumberedCommand(4_000_000_000 + i, c) for i, c in enumerate(commands)]
