"""What the station and its LoRa transceiver, an Arduino Mega, say to each other on USB: the single source.

`tools/gen_protocol.py` writes the C header of the firmware from these tables. On the wire a frame is its number, its
fields in their order, little-endian, and a CRC-16, stuffed so that a zero byte stands only at the end of a frame
(`transceiver_frame.py`).

The layout of `Announce` and `Hello` must never change: by them two versions find out that they differ.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Annotated, Any, get_args, get_type_hints

from shared.protocol.crc16 import crc16

VERSION = (1, 0)  # of the firmware; the fingerprint below tells whether two sides can talk

USB_BAUD = 500_000  # the fastest that 16 MHz divides exactly and every Mega's USB chip keeps up with
RADIO_BAUDS = (9_600, 19_200, 38_400, 57_600, 115_200)  # 230400 would be 3.5 % off at 16 MHz
DEFAULT_RADIO_BAUD = 115_200  # of an ES920LR as it comes
RADIOS = 2
MAX_DATA_BYTES = 64  # a radio packet of 50 bytes with its head and RSSI is one frame
RADIO_TO_HOST_BYTES = 2_048  # kept by the firmware until the host has acknowledged them: 178 ms at 115200
HOST_TO_RADIO_BYTES = 256
WINDOW_BYTES = 96  # unprocessed bytes a radio's stream may have on USB: both, with their frames, fit in the USB ring
ANNOUNCE_EVERY_MS = 250
PING_EVERY_MS = 100
HEALTH_EVERY_MS = 1_000
QUIET_AFTER_MS = 350  # a host that hears nothing says nothing more: the firmware may be in its boot loader
SESSION_TIMEOUT_MS = 1_500  # without a frame from the other side
RETRY_AFTER_MS = 60  # unacknowledged bytes are sent again; a busy host needs up to 20 ms to answer
COMMAND_RETRY_MS = 200
MAX_RESET_MS = 1_000

U8 = Annotated[int, "B"]
U16 = Annotated[int, "H"]
U32 = Annotated[int, "I"]


class ResetCause(IntEnum):
    """Why the firmware began; each has a detail."""

    POWER_ON = 0
    RESET_PIN = 1  # the button, or the host opened the port (DTR)
    BROWN_OUT = 2
    HUNG = 3  # the watchdog bit; detail: the number of the task that did not come back
    RING_STUCK = 4  # detail: the ring that did not move, 2 × port + (1 for sending)
    STACK_OVERFLOW = 5
    BAD_INTERRUPT = 6


class Task(IntEnum):
    """The tasks of the main loop in their order; the detail of `ResetCause.HUNG`."""

    FROM_HOST = 0
    TO_RADIO = 1
    FROM_RADIO = 2
    TO_HOST = 3
    COMMAND = 4
    SESSION = 5
    HEALTH = 6
    SUPERVISOR = 7
    REST = 8  # between two turns


class Port(IntEnum):
    """The firmware's serial ports; a radio's number is its port less one."""

    USB = 0
    RADIO_A = 1
    RADIO_B = 2


class Fault(IntEnum):
    """What is counted for each port and reported when it grows."""

    FRAMING = 0  # a byte without its stop bit; dropped
    OVERRUN = 1  # bytes the UART lost before its interrupt came
    RING_FULL = 2  # bytes the main loop did not fetch in time
    STREAM_FULL = 3  # bytes from a radio that the host did not take
    BAD_FRAME = 4  # frames damaged on USB


class Result(IntEnum):
    DONE = 0
    BAD_VALUE = 1


@dataclass(frozen=True, slots=True)
class Announce:
    """Mega: I am here and without a session. The host never speaks before it has heard the firmware: the boot loader
    stays for as long as bytes come in."""

    fingerprint: U16
    major: U8
    minor: U8
    reset_cause: U8
    reset_detail: U8


@dataclass(frozen=True, slots=True)
class Hello:
    """Host: begin a session; both sides forget all bytes on their way. Doing it twice with one number is once.

    `session`: any number but 0 that was not used lately.
    """

    fingerprint: U16
    session: U32


@dataclass(frozen=True, slots=True)
class Welcome:
    """Mega: the session has begun; the rest as in `Announce`, which a host that came back quickly has not heard."""

    session: U32
    major: U8
    minor: U8
    reset_cause: U8
    reset_detail: U8


@dataclass(frozen=True, slots=True)
class Refuse:
    """Mega: a `Hello` of another fingerprint than this, my own."""

    fingerprint: U16


@dataclass(frozen=True, slots=True)
class Goodbye:
    """Host: the session is over."""


@dataclass(frozen=True, slots=True)
class Data:
    """Bytes of a radio, from or to it; `offset` counts its bytes since the session began, modulo 65536."""

    radio: U8
    offset: U16
    data: bytes


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """The receiver of a radio's bytes has all before `received` and room for all before `limit`.

    `missing`: later bytes have come, those at `received` have not; they are sent again at once.
    """

    radio: U8
    received: U16
    limit: U16
    missing: U8 = 0


@dataclass(frozen=True, slots=True)
class Ping:
    """Host: are you there? Answered by two `Acknowledge` and, where wanted, by `Health` and two `RadioHealth`."""

    wants_health: U8


@dataclass(frozen=True, slots=True)
class SetBaud:
    """Host: change the rate of a radio's port once all bytes for it are out."""

    tag: U8
    radio: U8
    baud: U32


@dataclass(frozen=True, slots=True)
class ResetRadio:
    """Host: pull a radio's RESETB low for so long."""

    tag: U8
    radio: U8
    low_ms: U16


@dataclass(frozen=True, slots=True)
class Done:
    """Mega: the command with this tag has been carried out, or refused."""

    tag: U8
    result: U8


@dataclass(frozen=True, slots=True)
class Health:
    """Counters since the reset; `free_ram_bytes` is what the stack has never touched."""

    uptime_ms: U32
    reset_cause: U8
    reset_detail: U8
    free_ram_bytes: U16
    longest_loop_us: U16
    frames_in: U32
    usb_bad_frames: U16
    usb_framing: U16
    usb_overrun: U16
    usb_ring_full: U16
    usb_in_high_water: U8
    usb_out_high_water: U8


@dataclass(frozen=True, slots=True)
class RadioHealth:
    """Counters of one radio since the reset; the marks are of the bytes that waited at most."""

    radio: U8
    baud: U32
    bytes_in: U32
    bytes_out: U32
    resent_bytes: U16
    framing: U16
    overrun: U16
    ring_full: U16
    stream_full: U16
    ring_in_high_water: U8
    to_host_high_water: U16
    to_radio_high_water: U16


@dataclass(frozen=True, slots=True)
class FaultReport:
    """Mega: a counter grew; at most ten a second."""

    fault: U8
    port: U8
    total: U16


Frame = (
    Announce
    | Hello
    | Welcome
    | Refuse
    | Goodbye
    | Data
    | Acknowledge
    | Ping
    | SetBaud
    | ResetRadio
    | Done
    | Health
    | RadioHealth
    | FaultReport
)

FRAMES: dict[int, type[Any]] = {
    0x01: Announce,
    0x02: Hello,
    0x03: Welcome,
    0x04: Refuse,
    0x05: Goodbye,
    0x10: Data,
    0x11: Acknowledge,
    0x20: Ping,
    0x21: SetBaud,
    0x22: ResetRadio,
    0x23: Done,
    0x30: Health,
    0x31: RadioHealth,
    0x32: FaultReport,
}


@dataclass(frozen=True, slots=True)
class Layout:
    """How one kind of frame lies on the wire: numbers, and for `Data` bytes behind them."""

    number: int
    kind: type[Any]
    codes: tuple[tuple[str, str], ...]  # name of a number and its `struct` code
    has_data: bool

    @property
    def format(self) -> str:
        return "<" + "".join(code for _, code in self.codes)

    @property
    def size(self) -> int:
        return struct.calcsize(self.format)


def _layout(number: int, kind: type[Any]) -> Layout:
    hints = get_type_hints(kind, include_extras=True)
    codes = tuple((f.name, get_args(hints[f.name])[1]) for f in fields(kind) if hints[f.name] is not bytes)
    return Layout(number, kind, codes, has_data=bytes in hints.values())


LAYOUTS: dict[int, Layout] = {number: _layout(number, kind) for number, kind in FRAMES.items()}
LAYOUT_OF: dict[type[Any], Layout] = {layout.kind: layout for layout in LAYOUTS.values()}
MAX_BODY_BYTES = max(layout.size + MAX_DATA_BYTES * layout.has_data for layout in LAYOUTS.values())

_ENUMS = (ResetCause, Task, Port, Fault, Result)
FINGERPRINT = crc16(
    repr(
        (
            [(layout.number, layout.kind.__name__, layout.codes, layout.has_data) for layout in LAYOUTS.values()],
            [(e.__name__, [(m.name, m.value) for m in e]) for e in _ENUMS],
            (USB_BAUD, RADIO_BAUDS, DEFAULT_RADIO_BAUD, RADIOS, MAX_DATA_BYTES, RADIO_TO_HOST_BYTES),
            (HOST_TO_RADIO_BYTES, WINDOW_BYTES, SESSION_TIMEOUT_MS, MAX_RESET_MS),
        )
    ).encode()
)
