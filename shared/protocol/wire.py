"""The table of everything that crosses the air: the single source of the protocol.

A change here that an older peer would misread must change `VERSION`, which is below 7 (see `observations.py`).
"""

from __future__ import annotations

from shared import messages as m
from shared.geometry.se2 import Pose2
from shared.protocol.fields import (
    Both,
    Choice,
    DeltaSeries,
    DeltaTable,
    Flag,
    FloatTable,
    IndexPairs,
    LevelTable,
    Number,
    Pair,
    Record,
    Repeat,
    Text,
)

VERSION = 2

_U32 = Number("I")
_F32 = Number("f")
_F64 = Number("d")
_MILLI = Number("h", 0.001, allow_nan=True)  # ±32.767, "none" is a NaN
_MILLI_KNOWN = Number("h", 0.001)  # cannot be "none"
_CENTI = Number("h", 0.01, allow_nan=True)

_POSE = Record(Pose2, (("x_m", _F32), ("y_m", _F32), ("theta_rad", _F32)))
_ROUGH_POSE = Record(Pose2, (("x_m", Number("h", 0.01)), ("y_m", Number("h", 0.01)), ("theta_rad", _MILLI_KNOWN)))

_GEOMETRY = Record(
    m.ScanGeometry,
    (
        ("first_angle_rad", _F32),
        ("step_rad", _F32),
        ("beam_interval_s", _F32),
        ("range_min_m", _F32),
        ("range_max_m", _F32),
        ("robot_from_scanner", _POSE),
    ),
)

_OBJECTS = Record(m.ObjectNetwork, (("nodes_m", LevelTable(3, 0.001)), ("edges", IndexPairs())))

_SHARE = Number("H", 0.0001)  # 0 to 1
_TASK = Record(
    m.TaskVitals,
    (
        ("name", Text()),
        ("rate_hz", Number("H", 0.01)),
        ("late_share", _SHARE),
        ("over_budget_share", _SHARE),
        ("latest_s", Number("H", 0.0001)),
        ("longest_s", Number("H", 0.0001)),
    ),
)

REPORTS: dict[int, Record] = {
    1: Record(
        m.Observation,
        (
            ("sequence", _U32),
            ("stamp_s", _F64),
            ("odom_from_robot", _POSE),
            ("speed_mps", _MILLI_KNOWN),
            ("yaw_rate_radps", _MILLI_KNOWN),
            ("geometry", _GEOMETRY),
            ("ranges_m", DeltaSeries(0.001)),
            ("objects", _OBJECTS),
            ("has_objects", Flag()),
            ("boot_id", _U32),
        ),
    ),
    2: Record(
        m.Telemetry,
        (
            ("stamp_s", _F64),
            ("state", Choice(m.MissionState)),
            ("stop_reason", Choice(m.StopReason)),
            ("odom_from_robot", _POSE),
            ("speed_mps", _MILLI),
            ("yaw_rate_radps", _MILLI),
            ("steering_rad", _MILLI),
            ("battery_v", _MILLI),
            ("motor_current_a", _MILLI),
            ("cpu_temperature_c", _CENTI),
            ("distance_m", _F32),
            ("late_ticks", _U32),
            ("following_goal", _U32),
            ("faults", Repeat(Text())),
        ),
    ),
    3: Record(
        m.Hello,
        (
            ("robot_name", Text()),
            ("software_version", Text()),
            ("footprint_m", Repeat(Pair(_F32))),
            ("min_turning_radius_m", _F32),
        ),
    ),
    4: Record(m.Ack, (("command", _U32), ("accepted", Flag()), ("reason", Text()))),
    5: Record(m.Refusal, (("reason", Text()),)),
    6: Record(
        m.Pulse,
        (
            ("stamp_s", Number("I", 0.001)),
            ("state", Choice(m.MissionState)),
            ("stop_reason", Choice(m.StopReason)),
            ("odom_from_robot", _ROUGH_POSE),
            ("speed_mps", Number("b", 0.01)),
            ("steering_rad", Number("b", 0.01)),
            ("battery_v", Number("B", 0.04, allow_nan=True)),
            ("motor_current_a", Number("b", 0.1, allow_nan=True)),
            ("cpu_temperature_c", Number("b", 1.0, allow_nan=True)),
            ("distance_m", Number("H", 0.1)),
        ),
    ),
    7: Record(m.KeyframeWanted, ()),
    8: Record(
        m.Vitals,
        (
            ("stamp_s", Number("I", 0.001)),
            ("cores", _CENTI),
            ("memory_mb", Number("H", 0.1)),
            ("fan", Choice(m.FanState)),
            ("throttling", Repeat(Text())),
            ("tasks", Repeat(_TASK)),
            ("counters", Repeat(Both(Text(), Number("I")))),
        ),
    ),
}

COMMANDS: dict[int, Record] = {
    64: Record(m.Start, ()),
    65: Record(m.Stop, ()),
    66: Record(m.EmergencyStop, ()),
    67: Record(m.GoTo, (("goal_id", _U32), ("path", FloatTable(3)))),
    68: Record(m.Drive, (("speed_mps", _MILLI_KNOWN), ("steering_rad", _MILLI_KNOWN))),
    69: Record(m.Heartbeat, ()),
    71: Record(m.ReturnToStart, ()),
    72: Record(m.Pause, ()),
    73: Record(m.Resume, ()),
}

# The same commands in fewer bytes, for LoRa.
BRIEF: dict[int, Record] = {70: Record(m.GoTo, (("goal_id", _U32), ("path", DeltaTable((0.002, 0.002, 0.005)))))}

COMMAND_NUMBER = _U32
TYPE_OF: dict[type, int] = {record.kind: type_id for type_id, record in (REPORTS | COMMANDS).items()}
BRIEF_TYPE_OF: dict[type, int] = TYPE_OF | {record.kind: type_id for type_id, record in BRIEF.items()}
