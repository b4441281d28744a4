"""How states and figures are put to the operator."""

from __future__ import annotations

import math

from shared.link.base import LinkPath
from shared.messages import FanState, MissionState, StopReason, Telemetry, Vitals
from station_gui.mapping.snapshot import MapSnapshot, Tracking
from station_gui.model.goal_figures import GoalFigures, GoalState
from station_gui.model.view import LinkState, OperatorView
from station_gui.views.pose import robot_on_map

NO_VALUE = "–"
_LATE_SHARE = 0.005  # of the ticks, by more than 5 ms

STATE_NAMES = {
    MissionState.IDLE: "Idle",
    MissionState.OBSERVE: "Observe",
    MissionState.COMMAND: "Command",
    MissionState.RETURN: "Return",
    MissionState.PAUSED: "Paused",
    MissionState.HALTED: "Halted",
}

_STATE_SENTENCES = {
    MissionState.IDLE: "Ready. Press Start observation to map the room.",
    MissionState.OBSERVE: "Going round the room and building the first map.",
    MissionState.COMMAND: "The map is there. Send the robot to a place or drive it by hand.",
    MissionState.HALTED: "Halted.",
    MissionState.RETURN: "Going back to where it started.",
    MissionState.PAUSED: "Paused: it stands and keeps its mission.",
}

_STOP_SENTENCES = {
    StopReason.NONE: "",
    StopReason.OPERATOR: "Stopped by the operator.",
    StopReason.EMERGENCY: "Emergency stop: the drive is cut.",
    StopReason.COMMAND_SILENCE: "Stopped by itself: it heard nothing from the station.",
    StopReason.SENSOR_STALE: "Stopped: a sensor no longer delivers.",
    StopReason.DEVICE_FAULT: "Stopped: a device failed.",
    StopReason.LOW_BATTERY: "Stopped: the battery is low.",
    StopReason.OVER_TEMPERATURE: "Stopped: the computer is too hot.",
    StopReason.BLOCKED: "Stopped: something is in the way.",
    StopReason.TASK_FAULT: "Stopped: a task of its program failed.",
    StopReason.SHUTDOWN: "Stopped: its program is ending.",
    StopReason.STALLED: "Stopped: the motor pushes and the wheels do not turn, or the encoders failed.",
    StopReason.TILTED: "Stopped: the robot is tilted.",
    StopReason.ENCODER_FAULT: "Stopped: an encoder of a wheel failed.",
    StopReason.SENSORS_DISAGREE: "Stopped: gyro and encoders do not agree; it stands to learn the gyro anew.",
    StopReason.RESTARTED: "Paused: its program was started again.",
}

_WAITING_SENTENCES = {
    StopReason.SENSOR_STALE: "Standing for a moment: a sensor is late.",
    StopReason.DEVICE_FAULT: "Standing for a moment: a device does not answer.",
    StopReason.TASK_FAULT: "Standing for a moment: a task of its program failed.",
    StopReason.STALLED: "Standing for a moment: the wheels did not turn. It tries again.",
}

_LINK_SENTENCES = {
    LinkState.DISCONNECTED: "Not connected",
    LinkState.CONNECTING: "Connecting…",
    LinkState.CONNECTED: "Connected",
    LinkState.LOST: "Connection lost, trying again…",
}


def number(value: float | None, decimals: int = 0, unit: str = "") -> str:
    """The value with its unit, or a dash where there is none."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    shown = f"{value:.{decimals}f}"
    shown = shown.lstrip("-") if float(shown) == 0 else shown.replace("-", "\N{MINUS SIGN}")
    return f"{shown}{unit}" if unit.startswith("°") and unit != "°C" else f"{shown} {unit}".rstrip()


def bits_per_second(value: float) -> str:
    if not math.isfinite(value):
        return NO_VALUE
    return number(value / 1e6, 2, "Mbit/s") if value >= 1e6 else number(value / 1e3, 1, "kbit/s")


def age(age_s: float) -> str:
    """How long ago, in few letters."""
    if not math.isfinite(age_s):
        return "never"
    if age_s < 100:
        return f"{age_s:.1f} s"
    return f"{age_s / 60:.0f} min"


def schedule_text(telemetry: Telemetry, vitals: Vitals | None) -> str:
    """How punctual the robot's tasks are: the one that is late most often, over the last seconds."""
    skipped = f", {telemetry.late_ticks} ticks skipped" if telemetry.late_ticks else ""
    late = max(vitals.tasks, key=lambda task: task.late_share, default=None) if vitals is not None else None
    if late is None or late.late_share < _LATE_SHARE:
        return f"kept{skipped}"
    return f"{late.name} late {number(100 * late.late_share, 1)} %, to {number(1e3 * late.latest_s, 0, 'ms')}{skipped}"


def computer_text(vitals: Vitals | None) -> str:
    if vitals is None:
        return NO_VALUE
    fan = {FanState.UNKNOWN: "", FanState.OFF: ", fan off", FanState.ON: ", fan on"}[vitals.fan]
    held = f"{' and '.join(vitals.throttling)}, " if vitals.throttling else ""
    return f"{held}{number(vitals.cores, 2)} cores, {number(vitals.memory_mb, 0, 'MB')}{fan}"


def losses_text(vitals: Vitals | None) -> str:
    """What the devices lost since the robot's start."""
    if vitals is None:
        return NO_VALUE
    return ", ".join(f"{count} {name}" for name, count in vitals.counters if count) or "nothing lost"


def link_sentence(view: OperatorView) -> str:
    sentence = _LINK_SENTENCES[view.link_state]
    if view.link_state is not LinkState.CONNECTED:
        return f"No connection yet: {view.link.problem}" if view.link.problem else sentence
    if view.link.path is LinkPath.RADIO:
        return f"{sentence} over LoRa"
    return f"{sentence} to {view.target.host}:{view.target.port}" if view.target.host else sentence


def path_text(view: OperatorView) -> str:
    """What the observations come over, what stands by, and whether others can listen."""
    health, path = view.link.health, view.link.path
    if path is None:
        return NO_VALUE
    if path is LinkPath.RADIO:
        other = {None: "", True: ", Wi-Fi is back", False: ", no Wi-Fi"}[health.wifi]
    else:
        other = {None: "", True: ", LoRa ready", False: ", no LoRa"}[health.lora]
    return f"{path.value}{other}{'' if health.is_secret else ', open'}"


def tracking_sentence(snapshot: MapSnapshot) -> str:
    """What is known of the robot's place in the map; empty where there is nothing to say."""
    match snapshot.tracking:
        case Tracking.SEARCHING if snapshot.places:
            places = "1 place" if snapshot.places == 1 else f"{snapshot.places} places"
            return f"Its place in the map is looked for: {places} may be it."
        case Tracking.SEARCHING:
            return "Its place in the map is looked for."
        case Tracking.LOST:
            return "It is lost: no place of the map fits what it sees."
        case Tracking.APART:
            return "It is in a piece of map that is not joined to the rest, and may lie wrong."
        case _:
            return ""


def lost_hint(snapshot: MapSnapshot) -> str:
    """What stands across the map while the robot has no place in it; two lines."""
    if snapshot.tracking is Tracking.LOST:
        return "LOST\nNo place of the map fits what the robot sees"
    if snapshot.places == 1:
        return "LOOKING FOR THE ROBOT\nOne place may be it: driving on makes sure"
    if snapshot.places:
        return f"LOOKING FOR THE ROBOT\n{snapshot.places} places may be it: driving on tells them apart"
    return "LOOKING FOR THE ROBOT\nin the whole map"


def map_state(snapshot: MapSnapshot) -> str:
    """A word or two for the status bar."""
    known = {
        Tracking.LOCATED: "located",
        Tracking.SEARCHING: "searching",
        Tracking.LOST: "lost",
        Tracking.APART: "new piece",
    }[snapshot.tracking]
    return f"{known}, map is not changed" if snapshot.fixed else known


def mission_sentence(view: OperatorView, stale_after_s: float) -> str:
    """What the robot does, or why it does not, in one line."""
    if view.link_state is LinkState.DISCONNECTED:
        return "Not connected. Enter the robot's address on the left and press Connect."
    if view.link_state is not LinkState.CONNECTED:
        return _LINK_SENTENCES[view.link_state]
    if view.telemetry is None:
        return "Connected. Waiting for the robot's first report."
    if not view.telemetry_age_s <= stale_after_s:
        return f"No report from the robot for {age(view.telemetry_age_s)}."
    takes_goals = view.telemetry.state is MissionState.COMMAND and not view.telemetry.stop_reason
    if takes_goals and view.goal_m is not None:
        return _goal_sentence(view, view.goal_m)
    lost = tracking_sentence(view.snapshot) if view.snapshot is not None else ""
    sentence = _with_place(lost, view.telemetry) if lost else telemetry_sentence(view.telemetry)
    refusal = _refusal_sentence(view.going) if takes_goals else ""
    return f"{refusal} {sentence}" if refusal else sentence


def _with_place(lost: str, telemetry: Telemetry) -> str:
    """With a robot that has no place in the map there is nothing to send anywhere."""
    if telemetry.state is MissionState.COMMAND and not telemetry.stop_reason:
        return f"{lost} Drive it by hand until it is known."
    return f"{lost} {telemetry_sentence(telemetry)}"


def _goal_sentence(view: OperatorView, goal_m: tuple[float, float]) -> str:
    sentence = f"Going to x {number(goal_m[0], 2)}, y {number(goal_m[1], 2, 'm')}"
    pose = robot_on_map(view)
    if pose is not None:
        sentence += f": {number(math.hypot(goal_m[0] - pose.x_m, goal_m[1] - pose.y_m), 2, 'm')} away"
    return f"{sentence}.{_path_sentence(view.going)}"


def _path_sentence(going: GoalFigures | None) -> str:
    if going is None or not going.plans:
        return ""
    length, clear = number(going.length_m, 1, "m"), number(100 * going.clearance_m, 0, "cm")
    return f" Path {length}, {clear} clear, planned in {number(1000 * going.planning_s, 0, 'ms')}."


def _refusal_sentence(going: GoalFigures | None) -> str:
    """Why the last goal was not gone to; empty when it was, or another order came."""
    if going is None or going.state not in {GoalState.REFUSED, GoalState.GIVEN_UP}:
        return ""
    place = f"x {number(going.goal_m[0], 2)}, y {number(going.goal_m[1], 2, 'm')}"
    return f"The goal {place} was {going.state.value}: {going.reason}."


def telemetry_sentence(telemetry: Telemetry) -> str:
    runs = telemetry.state in {MissionState.OBSERVE, MissionState.COMMAND, MissionState.RETURN}
    waits = _WAITING_SENTENCES.get(telemetry.stop_reason, "") if runs else ""
    stop = waits or _STOP_SENTENCES.get(telemetry.stop_reason, "")
    state = _STATE_SENTENCES.get(telemetry.state, "")
    parts = [stop or state, *(f"Fault: {fault}." for fault in telemetry.faults)]
    if telemetry.state is MissionState.HALTED:
        parts.append("Press Continue to go on, or Start observation to begin anew.")
    if telemetry.state is MissionState.PAUSED:
        parts.append("Press Continue to go on.")
    return " ".join(parts)
