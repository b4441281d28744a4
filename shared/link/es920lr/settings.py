"""Every setting of the module: its range, its command, its line in `show`."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from shared.link.es920lr.airtime import Modulation

BROADCAST_ID = 0xFFFF
BAUD_RATES = (9_600, 19_200, 38_400, 57_600, 115_200, 230_400)  # commands 1 to 6
FACTORY_BAUD_RATE = 115_200
_BANDWIDTH_COMMANDS = {62_500: 3, 125_000: 4, 250_000: 5, 500_000: 6}
_CHANNELS = {62_500: 15, 125_000: 15, 250_000: 7, 500_000: 5}
_FIRST_CHANNEL_HZ = {62_500: 920_600_000, 125_000: 920_600_000, 250_000: 920_700_000, 500_000: 920_800_000}
_CHANNEL_STEP_HZ = {62_500: 200_000, 125_000: 200_000, 250_000: 400_000, 500_000: 600_000}
_SLEEP_TICK_S = 0.1


class Node(Enum):
    COORDINATOR = 1
    END_DEVICE = 2


class Transfer(Enum):
    PAYLOAD = 1
    FRAME = 2  # each payload is preceded by its destination


class BootMode(Enum):
    CONFIGURATION = 1
    OPERATION = 2


class Sleep(Enum):
    NONE = 1
    TIMER = 2
    INTERRUPT = 3


class Format(Enum):
    ASCII = 1
    BINARY = 2


class SettingsError(ValueError):
    """A value that the module does not have, or one that does not go with another."""


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """The defaults are the factory's."""

    node: Node = Node.END_DEVICE
    bandwidth_hz: int = 125_000
    spreading_factor: int = 7
    channel: int = 1
    pan_id: int = 0x0001
    own_id: int = 0x0001
    destination_id: int = 0x0000
    acknowledge: bool = True
    retries: int = 3
    transfer: Transfer = Transfer.PAYLOAD
    show_sender: bool = False
    show_rssi: bool = False
    boot_mode: BootMode = BootMode.CONFIGURATION
    baud_rate: int = FACTORY_BAUD_RATE
    sleep: Sleep = Sleep.NONE
    sleep_time_s: float = 5.0
    power_dbm: int = 13
    format: Format = Format.ASCII
    auto_send_interval_s: int = 0
    auto_send_text: str = ""

    def __post_init__(self) -> None:
        for problem in self._problems():
            raise SettingsError(problem)

    @property
    def modulation(self) -> Modulation:
        return Modulation(self.bandwidth_hz, self.spreading_factor)

    @property
    def frequency_hz(self) -> int:
        """The middle of the channel."""
        return _FIRST_CHANNEL_HZ[self.bandwidth_hz] + (self.channel - 1) * _CHANNEL_STEP_HZ[self.bandwidth_hz]

    def _problems(self) -> list[str]:
        problems = [
            *_outside("bandwidth_hz", self.bandwidth_hz, tuple(_BANDWIDTH_COMMANDS)),
            *_outside("spreading_factor", self.spreading_factor, range(7, 13)),
            *_outside("pan_id", self.pan_id, range(0x0001, 0xFFFF)),
            *_outside("own_id", self.own_id, range(0xFFFF)),
            *_outside("destination_id", self.destination_id, range(0x10000)),
            *_outside("retries", self.retries, range(11)),
            *_outside("baud_rate", self.baud_rate, BAUD_RATES),
            *_outside("power_dbm", self.power_dbm, range(-4, 14)),
            *_outside("auto_send_interval_s", self.auto_send_interval_s, range(86_401)),
        ]
        if problems:
            return problems
        channels = _CHANNELS[self.bandwidth_hz]
        if not 1 <= self.channel <= channels:
            problems.append(f"channel is 1 to {channels} at {self.bandwidth_hz / 1e3:g} kHz, not {self.channel}")
        if not 0.1 <= self.sleep_time_s <= 86_400.0:
            problems.append(f"sleep_time_s is 0.1 to 86400, not {self.sleep_time_s:g}")
        if not (len(self.auto_send_text) <= 50 and re.fullmatch(r"[ -~]*", self.auto_send_text)):
            problems.append("auto_send_text is at most 50 plain ASCII characters")
        return problems


def conflicts(settings: RadioSettings) -> list[str]:
    """Combinations that the module takes and that cannot be meant, each as one sentence."""
    found = []
    if settings.sleep is not Sleep.NONE and settings.node is not Node.END_DEVICE:
        found.append("only an end_device sleeps; set node=end_device or sleep=none")
    if settings.auto_send_interval_s and not settings.auto_send_text:
        found.append("auto_send_interval_s without auto_send_text: there is nothing to send")
    if settings.own_id == settings.destination_id:
        found.append(f"own_id and destination_id are both {settings.own_id:#06x}: the module would talk to itself")
    if settings.acknowledge and settings.destination_id == BROADCAST_ID:
        found.append("nobody acknowledges what is sent to all; set acknowledge=false or a destination_id")
    return found


def _outside(name: str, value: int, allowed: range | tuple[int, ...]) -> list[str]:
    if value in allowed:
        return []
    if isinstance(allowed, tuple):
        return [f"{name} is one of {', '.join(map(str, allowed))}, not {value}"]
    first, last = allowed[0], allowed[-1]
    if name.endswith("_id"):
        return [f"{name} is {first:#06x} to {last:#06x}, not {value:#06x}"]
    return [f"{name} is {first} to {last}, not {value}"]


@dataclass(frozen=True, slots=True)
class Row:
    """One setting as the module speaks of it."""

    field: str
    command: str
    short: str  # the command's one letter
    label: str  # in `show`
    to_command: Callable[[Any], str]
    from_command: Callable[[str], Any]
    to_show: Callable[[Any], str]
    from_show: Callable[[str], Any]


def _number(field: str, command: str, short: str, label: str, unit: str = "") -> Row:
    return Row(field, command, short, label, str, int, lambda v: f"{v}{unit}", lambda t: int(t.removesuffix(unit)))


def _identifier(field: str, command: str, short: str, label: str) -> Row:
    def shown(value: int) -> str:
        return f"{value:04X}"

    def read(text: str) -> int:
        return int(text, 16)

    return Row(field, command, short, label, shown, read, shown, read)


def _choice(field: str, command: str, short: str, label: str, names: Mapping[Any, str]) -> Row:
    """`names` are in the order of the numbers that the command takes, from 1 on."""
    values, texts = list(names), list(names.values())
    return Row(
        field,
        command,
        short,
        label,
        lambda v: str(values.index(v) + 1),
        lambda t: values[_positive(t) - 1],
        lambda v: texts[values.index(v)],
        lambda t: values[texts.index(t)],
    )


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


def _bandwidth_from_command(text: str) -> int:
    return {str(number): hz for hz, number in _BANDWIDTH_COMMANDS.items()}[text]


_ON_OFF = {True: "ON", False: "OFF"}
_BANDWIDTH = Row(
    "bandwidth_hz",
    "bw",
    "b",
    "Band Width",
    lambda hz: str(_BANDWIDTH_COMMANDS[hz]),
    _bandwidth_from_command,
    lambda hz: f"{hz / 1e3:g}kHz",
    lambda text: round(float(text.removesuffix("kHz")) * 1e3),
)
_BAUD_RATE = Row(
    "baud_rate",
    "baudrate",
    "r",
    "UART baudrate",
    lambda rate: str(BAUD_RATES.index(rate) + 1),
    lambda text: BAUD_RATES[_positive(text) - 1],
    str,
    int,
)
_SLEEP_TIME = Row(
    "sleep_time_s",
    "sleeptime",
    "t",
    "Sleep Time",
    lambda s: str(round(s / _SLEEP_TICK_S)),
    lambda text: _positive(text) * _SLEEP_TICK_S,
    lambda s: str(round(s / _SLEEP_TICK_S)),
    lambda text: _positive(text) * _SLEEP_TICK_S,
)

# In the order of `show`. The bandwidth stands before the channel, which it may move to 1.
ROWS = (
    _choice("node", "node", "a", "Node", {Node.COORDINATOR: "Coordinator", Node.END_DEVICE: "EndDevice"}),
    _BANDWIDTH,
    _number("spreading_factor", "sf", "c", "Spreading Factor"),
    _number("channel", "channel", "d", "Channel"),
    _identifier("pan_id", "panid", "e", "PAN ID"),
    _identifier("own_id", "ownid", "f", "Own Node ID"),
    _identifier("destination_id", "dstid", "g", "Destination ID"),
    _choice("acknowledge", "ack", "l", "Acknowledge", _ON_OFF),
    _number("retries", "retry", "m", "Retry count"),
    _choice("transfer", "transmode", "n", "Transfer Mode", {Transfer.PAYLOAD: "Payload", Transfer.FRAME: "Frame"}),
    _choice("show_sender", "rcvid", "o", "Receive Node ID information", _ON_OFF),
    _choice("show_rssi", "rssi", "p", "RSSI information", _ON_OFF),
    _choice(
        "boot_mode",
        "operation",
        "q",
        "Config/Operation",
        {BootMode.CONFIGURATION: "Configuration", BootMode.OPERATION: "Operation"},
    ),
    _BAUD_RATE,
    _choice(
        "sleep",
        "sleep",
        "s",
        "Sleep Mode",
        {Sleep.NONE: "No Sleep", Sleep.TIMER: "Timer Wakeup", Sleep.INTERRUPT: "INT Wakeup"},
    ),
    _SLEEP_TIME,
    _number("power_dbm", "power", "u", "Output Power", "dBm"),
    _choice("format", "format", "A", "Format", {Format.ASCII: "ASCII", Format.BINARY: "BINARY"}),
    _number("auto_send_interval_s", "sendtime", "B", "Send Time"),
    Row("auto_send_text", "senddata", "C", "Send Data", str, str, str, str),
)


@dataclass(frozen=True, slots=True)
class Command:
    """One line to the module, without its line end."""

    text: str
    new_baud_rate: int | None = None  # the module speaks at this rate right after its OK


def commands(wanted: RadioSettings, current: RadioSettings | None = None) -> tuple[Command, ...]:
    """What makes `wanted` of `current`, or of whatever is there; the baud rate comes last."""
    rows = [row for row in ROWS if current is None or _differs(row, wanted, current)]
    if current is not None and wanted.bandwidth_hz != current.bandwidth_hz:
        channel = next(row for row in ROWS if row.field == "channel")
        rows = [row for row in rows if row is not channel]
        rows.insert(rows.index(_BANDWIDTH) + 1, channel)  # the new bandwidth may have moved it
    rows.sort(key=lambda row: row is _BAUD_RATE)
    return tuple(_command(row, getattr(wanted, row.field)) for row in rows)


def _command(row: Row, value: Any) -> Command:
    text = f"{row.command} {row.to_command(value)}"
    return Command(text, value if row is _BAUD_RATE else None)


def _differs(row: Row, wanted: RadioSettings, current: RadioSettings) -> bool:
    return row.to_command(getattr(wanted, row.field)) != row.to_command(getattr(current, row.field))


@dataclass(frozen=True, slots=True)
class Shown:
    """What `show` said."""

    settings: RadioSettings
    other: tuple[tuple[str, str], ...]  # lines of a newer firmware


def parse_show(text: str) -> Shown:
    """Read the answer to `show`. Raises `SettingsError` when a line is missing or says something unknown."""
    lines = dict(re.findall(r"^[ \t]*([A-Z][\w/ ]*?) *: ?(.*?)[ \t\r]*$", text, re.MULTILINE))
    values: dict[str, Any] = {}
    for row in ROWS:
        if (shown := lines.pop(row.label, None)) is None:
            raise SettingsError(f"`show` has no line {row.label!r}: is this an ES920LR?")
        try:
            values[row.field] = row.from_show(shown)
        except (ValueError, IndexError, KeyError) as error:
            raise SettingsError(f"`show` says {row.label!r} is {shown!r}, which is not known") from error
    lines.pop("Effective Bitrate", None)
    return Shown(RadioSettings(**values), tuple(lines.items()))


def differences(wanted: RadioSettings, current: RadioSettings) -> tuple[tuple[str, Any, Any], ...]:
    """Field, current and wanted value of what is not the same."""
    return tuple(
        (f.name, getattr(current, f.name), getattr(wanted, f.name))
        for f in dataclasses.fields(RadioSettings)
        if getattr(current, f.name) != getattr(wanted, f.name)
    )
