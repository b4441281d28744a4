"""Battery voltage and motor current through an ADS1115 (register bits: TI data sheet SBAS444)."""

from __future__ import annotations

import itertools
import threading

from robot_app.drivers.base import DeviceError, PowerSample
from robot_app.drivers.config import FULL_SCALES_V, PowerConfig
from robot_app.drivers.i2c import I2cDevice
from shared.runtime.clock import Clock

_CONVERSION, _CONFIG = 0x00, 0x01
_START = 1 << 15  # as read: no conversion is under way
_SINGLE_ENDED = 0b100
_SINGLE_SHOT = 1 << 8
_RATE_860 = 0b111 << 5
_NO_COMPARATOR = 0b11
_CONVERSION_S = 1.1 / 860  # its clock is right to 10 %
_POLL_S = 0.0003
_GIVE_UP_S = 0.02
_FEWEST_LOOKS = 3  # a thread that was held up has not looked often
_FULL_SCALE_DIGITS = 32_768


class Ads1115:
    """One conversion of each channel with each read, about 3 ms; the stamp is that of the battery's."""

    def __init__(self, config: PowerConfig, clock: Clock) -> None:
        self._config = config
        self._clock = clock
        self._never = threading.Event()
        self._closed = False
        self._volts_per_digit = config.full_scale_v / _FULL_SCALE_DIGITS
        self._device = I2cDevice("power monitor ADS1115", config.bus, config.address)
        try:
            self._convert_v(config.battery_channel)
        except DeviceError:
            self._device.close()
            raise

    def read(self, timeout_s: float) -> PowerSample:
        """Does not wait longer than the two conversions take. Raises `DeviceError`; the next read tries again."""
        if self._closed:
            raise DeviceError(f"{self._device.name}: is closed")
        c = self._config
        battery_v = self._convert_v(c.battery_channel) * c.battery_divider
        stamp_s = self._clock.now_s()
        current_a = (self._convert_v(c.current_channel) - c.current_zero_v) / c.current_v_per_a
        return PowerSample(stamp_s, battery_v, current_a)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._device.close()

    def _convert_v(self, channel: int) -> float:
        """The voltage between a pin and ground. Each conversion sets all it needs: a reset chip does no harm."""
        gain = FULL_SCALES_V.index(self._config.full_scale_v)
        setting = _START | (_SINGLE_ENDED | channel) << 12 | gain << 9 | _SINGLE_SHOT | _RATE_860 | _NO_COMPARATOR
        self._device.write(_CONFIG, *setting.to_bytes(2, "big"))
        due_s = self._clock.now_s() + _GIVE_UP_S
        self._pause(_CONVERSION_S)
        for looks in itertools.count(1):
            asked_s = self._clock.now_s()  # before the answer: a thread held up after it would give up too early
            setting_read = int.from_bytes(self._device.read((_CONFIG, 2))[0], "big")
            if (setting_read ^ setting) & ~_START:
                raise DeviceError(
                    f"{self._device.name}: does not keep its setting; is a wire loose, did its supply fail?"
                )
            if setting_read & _START:
                break
            if asked_s > due_s and looks > _FEWEST_LOOKS:
                raise DeviceError(f"{self._device.name}: a conversion does not end")
            self._pause(_POLL_S)
        (data,) = self._device.read((_CONVERSION, 2))
        return int.from_bytes(data, "big", signed=True) * self._volts_per_digit

    def _pause(self, seconds: float) -> None:
        self._clock.wait(self._never, self._clock.now_s() + seconds)
