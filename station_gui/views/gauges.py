"""The monitoring gauges: what the robot reports about itself."""

from __future__ import annotations

import math

from PySide6.QtWidgets import QHBoxLayout

from shared.messages import Telemetry
from station_gui.model.view import OperatorView
from station_gui.qt import theme
from station_gui.qt.dials import NOTHING, Band, Battery, Compass, Dial, Gauge, Reading
from station_gui.qt.widgets import Panel, label, set_property
from station_gui.views import words
from station_gui.views.config import GaugeConfig
from station_gui.views.pose import robot_on_map


class GaugePanel(Panel):
    """Speed, steering, heading, battery, motor current and temperature; grey when the telemetry is old."""

    def __init__(self, config: GaugeConfig) -> None:
        super().__init__("Robot")
        self._config = config
        self._age = label("", "muted")
        self.header.addWidget(self._age)
        self.speed = _speed_dial(config)
        self.steering = _steering_dial(config)
        self.heading = Compass("Heading")
        self.battery = Battery("Battery", config.battery_empty_v, config.battery_full_v)
        self.current = _current_dial(config)
        self.temperature = _temperature_dial(config)
        row = QHBoxLayout()
        row.setSpacing(4)
        for gauge in self.gauges():
            row.addWidget(gauge, 1)
        self.body.addLayout(row, 1)

    def gauges(self) -> tuple[Gauge, ...]:
        return self.speed, self.steering, self.heading, self.battery, self.current, self.temperature

    def show_view(self, view: OperatorView) -> None:
        telemetry = view.telemetry
        stale = not view.telemetry_age_s <= self._config.stale_after_s
        self._show_age(view, stale)
        if telemetry is None:
            for gauge in self.gauges():
                gauge.show_reading(NOTHING)
            return
        self.speed.show_reading(speed_reading(telemetry.speed_mps, self._config, stale))
        self.steering.show_reading(steering_reading(telemetry.steering_rad, stale))
        self.heading.show_reading(heading_reading(view, telemetry, stale))
        self.battery.show_reading(battery_reading(telemetry.battery_v, self._config, stale))
        self.current.show_reading(current_reading(telemetry.motor_current_a, self._config, stale))
        self.temperature.show_reading(temperature_reading(telemetry.cpu_temperature_c, self._config, stale))

    def _show_age(self, view: OperatorView, stale: bool) -> None:
        if view.telemetry is None:
            self._age.setText("no telemetry yet")
        elif stale:
            self._age.setText(f"telemetry is {words.age(view.telemetry_age_s)} old")
        else:
            self._age.setText(f"driven {words.number(view.telemetry.distance_m, 1, 'm')}")
        set_property(self._age, "tone", "warning" if stale and view.telemetry is not None else "")


def speed_reading(speed_mps: float, config: GaugeConfig, stale: bool) -> Reading:
    """The dial shows how fast, the note which of the paper's bands, and whether it goes backward."""
    magnitude = abs(speed_mps)
    if not math.isfinite(magnitude):
        return Reading(math.nan, words.NO_VALUE, stale=stale)
    if magnitude < 0.005:
        note, colour = "standing", theme.MUTED
    elif magnitude < config.slow_mps:
        note, colour = "slow", theme.ACCENT
    elif magnitude <= config.fast_mps:
        note, colour = "medium", theme.GOOD
    else:
        note, colour = "fast", theme.WARNING
    if speed_mps < 0 and magnitude >= 0.005:
        note += ", backward"
    return Reading(round(magnitude, 3), words.number(magnitude, 2, "m/s"), note, colour, stale)


def steering_reading(steering_rad: float, stale: bool) -> Reading:
    degrees = math.degrees(steering_rad)
    if not math.isfinite(degrees):
        return Reading(math.nan, words.NO_VALUE, stale=stale)
    note = "straight" if abs(degrees) < 0.5 else "left" if degrees > 0 else "right"
    # The scale grows to the right, the angle to the left.
    return Reading(round(-degrees, 1), words.number(abs(degrees), 0, "°"), note, theme.MUTED, stale)


def heading_reading(view: OperatorView, telemetry: Telemetry, stale: bool) -> Reading:
    pose = robot_on_map(view)
    frame = "on the map"
    if pose is None:
        pose, frame = telemetry.odom_from_robot, "by odometry"
    degrees = math.degrees(pose.theta_rad)
    if not math.isfinite(degrees):
        return Reading(math.nan, words.NO_VALUE, stale=stale)
    return Reading(round(degrees, 1), words.number(degrees, 0, "°"), frame, theme.MUTED, stale)


def battery_reading(battery_v: float, config: GaugeConfig, stale: bool) -> Reading:
    if not math.isfinite(battery_v):
        return Reading(math.nan, words.NO_VALUE, "not measured", theme.MUTED, stale)
    if battery_v < (config.battery_low_v + config.battery_empty_v) / 2:
        note, colour = "nearly empty", theme.BAD
    elif battery_v < config.battery_low_v:
        note, colour = "low", theme.WARNING
    else:
        note, colour = "good", theme.GOOD
    return Reading(round(battery_v, 2), words.number(battery_v, 2, "V"), note, colour, stale)


def current_reading(current_a: float, config: GaugeConfig, stale: bool) -> Reading:
    if not math.isfinite(current_a):
        return Reading(math.nan, words.NO_VALUE, "not measured", theme.MUTED, stale)
    high = current_a > 0.75 * config.max_current_a
    note, colour = ("high", theme.WARNING) if high else ("normal", theme.GOOD)
    return Reading(round(current_a, 2), words.number(current_a, 1, "A"), note, colour, stale)


def temperature_reading(temperature_c: float, config: GaugeConfig, stale: bool) -> Reading:
    if not math.isfinite(temperature_c):
        return Reading(math.nan, words.NO_VALUE, "not measured", theme.MUTED, stale)
    if temperature_c >= config.hot_c:
        note, colour = "throttled", theme.BAD
    elif temperature_c >= config.throttle_c:
        note, colour = "throttling", theme.BAD
    elif temperature_c >= config.warm_c:
        note, colour = "warm", theme.WARNING
    else:
        note, colour = "good", theme.GOOD
    return Reading(round(temperature_c, 1), words.number(temperature_c, 0, "°C"), note, colour, stale)


def _speed_dial(config: GaugeConfig) -> Dial:
    high = max(config.max_speed_mps, config.fast_mps) + 0.04
    bands = (Band(config.slow_mps, theme.ACCENT), Band(config.fast_mps, theme.GOOD), Band(high, theme.WARNING))
    marks = ((0.0, "0"), (config.slow_mps, f"{config.slow_mps:.1f}"), (config.fast_mps, f"{config.fast_mps:.1f}"))
    return Dial("Speed", 0.0, high, bands, marks)


def _steering_dial(config: GaugeConfig) -> Dial:
    high = math.degrees(config.max_steering_rad)
    bands = (Band(-0.8 * high, theme.WARNING), Band(0.8 * high, theme.MUTED), Band(high, theme.WARNING))
    return Dial("Steering", -high, high, bands, ((-high / 2, "L"), (0.0, "0"), (high / 2, "R")))


def _current_dial(config: GaugeConfig) -> Dial:
    high = config.max_current_a
    bands = (Band(0.75 * high, theme.GOOD), Band(high, theme.WARNING))
    return Dial("Motor current", 0.0, high, bands, ((0.0, "0"), (high / 2, f"{high / 2:.0f}"), (high, f"{high:.0f}")))


def _temperature_dial(config: GaugeConfig) -> Dial:
    bands = (
        Band(config.warm_c, theme.GOOD),
        Band(config.throttle_c, theme.WARNING),
        Band(config.hot_c, "#f26a30"),
        Band(95.0, theme.BAD),
    )
    marks = ((20.0, "20"), (50.0, "50"), (config.throttle_c, f"{config.throttle_c:.0f}"))
    return Dial("CPU", 20.0, 95.0, bands, marks)
