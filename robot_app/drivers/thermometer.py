"""Temperature of the processor, and whether the firmware has slowed it down."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path

from robot_app.drivers.base import DeviceError, TemperatureSample
from robot_app.drivers.config import ThermometerConfig
from shared.runtime.clock import Clock

_log = logging.getLogger(__name__)
_FLAGS = ("under-voltage", "frequency capped", "throttled", "soft temperature limit")  # bits 0 to 3: now


class CpuThermometer:
    def __init__(self, config: ThermometerConfig, clock: Clock) -> None:
        self._zone = Path(config.zone)
        self._throttled = Path(config.throttled)
        self._clock = clock
        self._fan = _find_fan(Path(config.cooling))
        self._closed = False
        self._flags: tuple[str, ...] = ()
        self._read_c()

    def read(self, timeout_s: float) -> TemperatureSample:
        """Does not wait."""
        if self._closed:
            raise DeviceError("thermometer: is closed")
        self._read_flags()
        return TemperatureSample(self._clock.now_s(), self._read_c(), self._flags, self._read_fan())

    def close(self) -> None:
        self._closed = True

    def _read_c(self) -> float:
        try:
            return int(self._zone.read_text("ascii")) / 1000
        except (OSError, ValueError) as error:
            raise DeviceError(
                f"thermometer at {self._zone}: cannot be read: {error}; is this a Raspberry Pi?"
            ) from error

    def _read_fan(self) -> bool | None:
        """The kernel's gpio-fan is a cooling device whose state is its speed."""
        try:
            return int(self._fan.read_text("ascii")) > 0 if self._fan is not None else None
        except (OSError, ValueError):
            return None

    def _read_flags(self) -> None:
        try:
            bits = int(self._throttled.read_text("ascii").strip(), 16)
        except (OSError, ValueError):
            return  # only the Raspberry Pi's own kernel has it
        flags = tuple(name for i, name in enumerate(_FLAGS) if bits >> i & 1)
        if flags != self._flags:
            _log.warning("processor: %s", ", ".join(flags) or "runs freely again")
        self._flags = flags


def _find_fan(cooling: Path) -> Path | None:
    for kind in sorted(cooling.glob("cooling_device*/type")):
        with contextlib.suppress(OSError):
            if "fan" in kind.read_text("ascii", "replace"):
                return kind.with_name("cur_state")
    return None
