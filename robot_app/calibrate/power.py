"""`calibrate power`: battery voltage against a multimeter, and the current sensor's zero."""

from __future__ import annotations

import math

from robot_app.calibrate.change import Change
from robot_app.calibrate.estimate import steady
from robot_app.calibrate.guide import CalibrationError, Guide
from robot_app.calibrate.sampling import collect
from robot_app.config import AnyRobotConfig
from robot_app.drivers.base import PowerMonitor
from shared.runtime.clock import Clock

_SAMPLES, _EVERY_S = 60, 0.01
_METER = 0.005  # of a common multimeter, share of its reading
_LEAST_PIN_V = 0.2
_MOST_ZERO_A = 5.0  # farther off is another sensor, or its wire


def calibrate_power(monitor: PowerMonitor, config: AnyRobotConfig, guide: Guide, clock: Clock) -> list[Change]:
    """The motor must stand; raises `CalibrationError` for readings that are none."""
    p = config.devices.power
    guide.say("The motor stays off. Everything else should run as it does on the road.")
    meter_v = guide.number("What does a multimeter say at the battery's terminals, in volts?", 1.0, 60.0)
    samples = collect(clock, _SAMPLES, _EVERY_S, lambda: monitor.read(0.05), "power monitor")
    battery = steady([s.battery_v for s in samples])
    current = steady([s.motor_current_a for s in samples])
    pin_v = battery.value / p.battery_divider
    if pin_v < _LEAST_PIN_V:
        raise CalibrationError(f"only {pin_v:.2f} V at the converter's pin: is the battery's divider connected?")
    if abs(current.value) > _MOST_ZERO_A:
        raise CalibrationError(f"{current.value:+.1f} A with the motor off: is the current sensor connected?")
    divider = meter_v / pin_v
    if divider < 1 or pin_v > 0.98 * p.full_scale_v:
        raise CalibrationError(
            f"{pin_v:.2f} V at the pin of a battery of {meter_v:.2f} V: the divider does not fit the converter's range "
            f"(devices.power.full_scale_v is {p.full_scale_v:g})"
        )
    divider_sigma = divider * math.hypot(_METER, battery.sigma / battery.value)
    zero_v = p.current_zero_v + current.value * p.current_v_per_a
    return [
        Change("devices.power.battery_divider", p.battery_divider, divider, f"± {divider_sigma:.3f}"),
        Change(
            "devices.power.current_zero_v",
            p.current_zero_v,
            zero_v,
            f"± {abs(current.sigma * p.current_v_per_a):.4f} V",
        ),
    ]
