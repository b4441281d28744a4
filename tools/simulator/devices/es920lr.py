"""An ES920LR at its serial wire, as firmware 1.12 behaves: the same answers, modes, flash memory and faults."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from enum import Enum

from shared.link.es920lr.airtime import MAX_PAYLOAD_BYTES
from shared.link.es920lr.parser import MODE_QUESTION
from shared.link.es920lr.settings import (
    BootMode,
    Format,
    Node,
    RadioSettings,
    Sleep,
    Transfer,
)
from tools.simulator.devices.es920lr_console import Console
from tools.simulator.devices.es920lr_mac import CHANNEL_BUSY, NO_ACKNOWLEDGEMENT, Mac
from tools.simulator.radio.channel import Antenna, RadioChannel, RadioFrame
from tools.simulator.radio.timeline import Entry, Timeline
from tools.simulator.radio.uart import SerialLine

_BOOT_S = 0.005
_BOOT_NOISE = {19_200: b"\xff", 38_400: b"\xff\xff", 57_600: b"\xff\xff", 115_200: b"\xfc\xfc", 230_400: b"\xe0\xe0"}
_HALF_FRAME_S = 0.5
_BUFFER_BYTES = 256
_WORD = b"config"
_FRAME_HEAD = 8  # PAN and destination of frame mode
_FLASH_S = 0.03  # erasing and writing with interrupts off
_LENGTH, _BUSY = 100, 101
_WORDS = {
    None: "",
    _LENGTH: "send data length too long\r\n",
    _BUSY: "send data failed\r\n",
    CHANNEL_BUSY: "carrier sense failed\r\n",
    NO_ACKNOWLEDGEMENT: "Ack Timeout\r\n",
}


class State(Enum):
    OFF = "no power"
    BOOTING = "boots"
    CONFIGURATION = "is configured"
    OPERATION = "operates"
    ASLEEP = "sleeps"


class EmulatedEs920lr:
    """A module with a serial line and an antenna; it begins without power. `flash` is what it keeps without."""

    def __init__(
        self,
        timeline: Timeline,
        channel: RadioChannel,
        name: str,
        flash: RadioSettings | None = None,
        position_m: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.name = name
        self.flash = flash or RadioSettings()
        self.flash_is_for_people = False  # it was saved in terminal mode
        self.flash_refusal: int | None = None  # 3 or 4: what `save` is refused with
        self.flash_writes = 0
        self.configuration_pin = False  # held low, it asks for the mode at every boot
        self.state = State.OFF
        self.line = SerialLine(timeline, self.flash.baud_rate, self._take_byte)
        self.antenna = Antenna(name, self._heard, position_m)
        self.mac = Mac(timeline, channel, self.antenna, self._deliver, self._done, self.line.occupy)
        self._timeline = timeline
        self._settings = self.flash
        self._for_people = False
        self._buffer = bytearray(_BUFFER_BYTES)
        self._index = 0
        self._last_byte_s: float | None = None
        self._due: list[Entry] = []
        self._console = Console(self)
        channel.attach(self.antenna)

    @property
    def settings(self) -> RadioSettings:
        """What holds now; the flash memory may hold something else."""
        return self._settings

    def power_on(self) -> None:
        if self.state is State.OFF:
            self._boot()

    def power_off(self) -> None:
        """What it was sending breaks off; what was not saved is gone."""
        for entry in self._due:
            entry.cancel()
        self._due.clear()
        self.mac.stop()
        self.line.cut()
        self.state = State.OFF

    def reset(self) -> None:
        """The reset pin."""
        if self.state is not State.OFF:
            self.power_off()
            self._boot()

    def wake_pin(self) -> None:
        """The pin that wakes a module from interrupt sleep, and sends it there again."""
        if self._settings.sleep is not Sleep.INTERRUPT:
            return
        if self.state is State.ASLEEP:
            self._wake()
        elif self.state is State.OPERATION:
            self._fall_asleep()

    # What the console may do.

    def change(self, settings: RadioSettings) -> None:
        """New settings in memory; the serial line follows at once."""
        self._settings = settings
        self.line.baud_rate = settings.baud_rate

    def save(self) -> int | None:
        """Write the flash memory; the number of the NG, or None."""
        self.line.occupy(_FLASH_S)
        if self.flash_refusal is None:
            self.flash, self.flash_is_for_people = self._settings, self._console.for_people
            self.flash_writes += 1
        return self.flash_refusal

    def start(self) -> None:
        self._for_people = self._console.for_people
        self._operate()

    def _boot(self) -> None:
        self.state = State.BOOTING
        self._settings = self.flash
        self.line.baud_rate = self.flash.baud_rate
        self._buffer = bytearray(_BUFFER_BYTES)
        self._index, self._last_byte_s = 0, None
        self._after(_BOOT_S, self._booted)

    def _booted(self) -> None:
        self.line.powered = True
        self.line.say(_BOOT_NOISE.get(self.line.baud_rate, b""))
        if self._settings.boot_mode is BootMode.CONFIGURATION or self.configuration_pin:
            self.state = State.CONFIGURATION
            self._console = Console(self)
            self.line.say(b"\r\n" + MODE_QUESTION)
        else:
            self._for_people = self.flash_is_for_people
            self._operate()

    def _operate(self) -> None:
        self.state = State.OPERATION
        self._index, self._last_byte_s = 0, None
        self.line.say(b"\r\n ----- operation mode is ready ----- \r\n" if self._for_people else b"\r\n")
        self.mac.start(self._settings)
        if self._settings.sleep is not Sleep.NONE and self._settings.node is Node.END_DEVICE:
            self._fall_asleep()
        elif self._settings.auto_send_interval_s:
            self._auto_send()

    def _fall_asleep(self) -> None:
        self.state = State.ASLEEP
        self.mac.stop()
        self.line.powered = False
        if self._settings.sleep is Sleep.TIMER:
            self._after(self._settings.sleep_time_s, self._wake)

    def _wake(self) -> None:
        self.state = State.OPERATION
        self.line.powered = True
        self.mac.start(self._settings)
        if self._settings.auto_send_interval_s:
            self._auto_send()

    def _after(self, delay_s: float, action: Callable[[], None]) -> None:
        self._due = [entry for entry in self._due if not entry.cancelled]

        def act() -> None:
            entry.cancel()
            action()

        entry = self._timeline.after(delay_s, act)
        self._due.append(entry)

    def _take_byte(self, byte: int) -> None:
        if self.state is State.CONFIGURATION:
            self._console.take(byte)
        elif self.state is State.OPERATION:
            if self._settings.format is Format.ASCII:
                self._take_ascii(byte)
            else:
                self._take_binary(byte)

    def _take_ascii(self, byte: int) -> None:
        self._buffer[self._index] = byte
        if self._index and self._buffer[self._index - 1 : self._index + 1] == b"\r\n":
            line = bytes(self._buffer[: self._index - 1])
            self._index = 0
            if line == _WORD:
                self._remember_to_configure()
            elif text := line.partition(b"\x00")[0]:
                self._send(text)
        else:
            self._index = (self._index + 1) % _BUFFER_BYTES

    def _take_binary(self, byte: int) -> None:
        now_s = self._timeline.now_s
        if self._last_byte_s is not None and now_s - self._last_byte_s >= _HALF_FRAME_S:
            self._index = 0
        self._last_byte_s = now_s
        self._buffer[self._index] = byte
        if self._index == 5 and bytes(self._buffer[:7]) == _WORD + b"\x00":
            self._last_byte_s = None  # its timer stands still, and the index stays where it is
            self._remember_to_configure()
        elif self._index and self._index == self._buffer[0]:
            self._index, self._last_byte_s = 0, None
            self._send(bytes(self._buffer[1 : 1 + self._buffer[0]]))
        else:
            self._index = (self._index + 1) % _BUFFER_BYTES

    def _remember_to_configure(self) -> None:
        """It says nothing, and asks for the mode from its next reset on."""
        self.line.occupy(_FLASH_S)
        self.flash = dataclasses.replace(self._settings, boot_mode=BootMode.CONFIGURATION)
        self.flash_is_for_people = self._for_people
        self.flash_writes += 1

    def _send(self, data: bytes) -> None:
        pan_id, destination_id = self._settings.pan_id, self._settings.destination_id
        head = _FRAME_HEAD if self._settings.transfer is Transfer.FRAME else 0
        if not head < len(data) <= MAX_PAYLOAD_BYTES + head:
            self._reply(_LENGTH)
            return
        if self.mac.is_sending:
            self._reply(_BUSY)
            return
        if head:
            pan_id, destination_id = _identifier(data[:4]), _identifier(data[4:8])
        self.mac.send(data[head:], pan_id, destination_id)

    def _auto_send(self) -> None:
        if self._settings.auto_send_text:
            self._send(self._settings.auto_send_text.encode("ascii"))

    def _heard(self, frame: RadioFrame, power_dbm: float) -> None:
        self.mac.heard(frame, power_dbm)

    def _done(self, refusal: int | None) -> None:
        self._reply(refusal)
        if self._settings.sleep is Sleep.TIMER and self._settings.node is Node.END_DEVICE:
            self._fall_asleep()
        elif self._settings.auto_send_interval_s:
            self._after(self._settings.auto_send_interval_s, self._auto_send)

    def _reply(self, refusal: int | None) -> None:
        text = b"OK" if refusal is None else b"NG %03d" % refusal
        if self._for_people:
            self.line.say(_WORDS.get(refusal, "Send Failed\r\n").encode("ascii"))
        elif self._settings.format is Format.ASCII:
            self.line.say(text + b"\r\n")
        else:
            self.line.say(bytes((len(text),)) + text)

    def _deliver(self, frame: RadioFrame, power_dbm: float) -> None:
        s = self._settings
        rssi_dbm = math.floor(power_dbm)
        if self._for_people:
            head = f"RSSI({rssi_dbm}dBm):PAN ID({frame.pan_id:04X}):Src ID({frame.source_id:04X}):Receive Data("
            self.line.say(head.encode("ascii") + frame.payload + b")\r\n")
            return
        rssi = b"%04X" % (rssi_dbm & 0xFFFF) if s.show_rssi else b""
        sender = b"%04X%04X" % (frame.pan_id, frame.source_id) if s.show_sender else b""
        text = rssi + sender + frame.payload
        if s.format is Format.ASCII:
            self.line.say(text + b"\r\n")
        else:
            self.line.say(bytes((len(text),)) + text)


def _identifier(digits: bytes) -> int:
    """Four hex digits as the firmware reads them: what is none counts as zero."""
    value = 0
    for digit in digits:
        value = value << 4 | (int(chr(digit), 16) if chr(digit) in "0123456789abcdefABCDEF" else 0)
    return value
