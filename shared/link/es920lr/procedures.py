"""How to find a module, configure it and start it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from shared.link.es920lr.dialogue import (
    Answer,
    Ask,
    DialogueError,
    Procedure,
    ResetModule,
    Said,
    SetBaudRate,
    Wait,
)
from shared.link.es920lr.settings import (
    BAUD_RATES,
    FACTORY_BAUD_RATE,
    Command,
    Format,
    RadioSettings,
    SettingsError,
    Shown,
    Sleep,
    Transfer,
    commands,
    parse_show,
)

_TRIES = 3
_ANSWER_S = 0.3  # besides the time on the line; the transceiver and USB are part of it
_FLASH_S = 2.0  # erasing and writing the sector
_WORD_S = 0.5  # the same, of which the module says nothing
BOOT_S = 0.4
_HALF_FRAME_S = 0.7  # a module in operation forgets a half frame after 0.5 s
_LINE = "Is the line sound? Try again, or take a lower baud_rate"
_CONFIGURATION_WORD = b"config"
_REFUSALS = {
    1: "it does not know the command",
    2: "it does not have that value",
    3: "its flash memory cannot be erased",
    4: "its flash memory cannot be written",
    5: "its flash memory cannot be read",
}


class Mode(Enum):
    """What a module was found doing."""

    QUESTION = "asks for the mode"
    PROCESSOR = "is being configured by a program"
    TERMINAL = "is being configured by a person"
    BINARY = "operates, binary format"
    ASCII = "operates, ASCII format"


@dataclass(frozen=True, slots=True)
class Found:
    mode: Mode
    baud_rate: int


@dataclass(frozen=True, slots=True)
class Running:
    """The module operates. `settings` is None when it already did, and so could not be asked for them."""

    settings: RadioSettings | None


def find(baud_rates: tuple[int, ...] = ()) -> Procedure[Found]:
    """Find out at which rate the module speaks and what it is doing, without sending anything over the air.

    A frame that is too long is refused by a module in operation, in the format it uses; the same bytes with a line
    end are refused by one that is being configured.
    """
    # The likely rate comes twice: half a frame of an earlier program may have swallowed the first question.
    for baud_rate in (*baud_rates, *dict.fromkeys((*baud_rates, FACTORY_BAUD_RATE, *BAUD_RATES))):
        yield SetBaudRate(baud_rate)
        mode = yield from _recognise(baud_rate)
        if mode is not None:
            return Found(mode, baud_rate)
        yield Ask(b"", Wait.QUIET, _HALF_FRAME_S - _ANSWER_S)  # what it took for the beginning of a frame is forgotten
    raise DialogueError("no answer at any baud rate. Is the module powered, and are RX and TX the right way round?")


def _recognise(baud_rate: int) -> Procedure[Mode | None]:
    too_long = bytes([60]) + b"~" * 60
    answer = yield _ask(too_long, Wait.REPLY, baud_rate)
    if answer.said is Said.BINARY:
        return Mode.BINARY
    if answer.said is Said.MODE_QUESTION:
        return Mode.QUESTION
    answer = yield _ask(b"\r\n", Wait.REPLY, baud_rate)
    if answer.said is Said.BINARY:  # the frame before had lost bytes to noise
        yield Ask(b"", Wait.QUIET, _HALF_FRAME_S)
        return Mode.BINARY
    modes = {
        (Said.REFUSED, 1): Mode.PROCESSOR,
        (Said.REFUSED, 2): Mode.QUESTION,
        (Said.REFUSED, 100): Mode.ASCII,
        (Said.MODE_QUESTION, 0): Mode.QUESTION,
        (Said.PROMPT, 0): Mode.TERMINAL,
    }
    if "length too long" in answer.text:  # it was saved by a person, and operates for one
        return Mode.ASCII
    return modes.get((answer.said, answer.refusal))


def bring_up(wanted: RadioSettings, can_reset: bool) -> Procedure[Running]:
    """Bring a module in whatever state to operate with `wanted`; nothing is written to its flash memory.

    A module that operates cannot be asked what it is set to. Where it can be reset it is: one that begins in
    configuration is then set anew. One that begins in operation is believed to have been saved as wanted.
    """
    require_usable(wanted)
    found = yield from find((wanted.baud_rate,))
    if found.mode is Mode.BINARY and can_reset:
        if (yield from _asks_after_reset()):
            found = Found(Mode.QUESTION, found.baud_rate)
        else:  # it operates again, or asks at the rate that it was saved with
            found = yield from find((found.baud_rate,))
    if found.mode is Mode.BINARY:
        return Running(None)
    if found.mode in {Mode.ASCII, Mode.TERMINAL}:
        yield from _enter_by_reset(found, can_reset)
    elif found.mode is Mode.QUESTION:
        yield from _choose_processor()
    return (yield from _set_and_start(wanted))


def _asks_after_reset(boot_s: float = BOOT_S) -> Procedure[bool]:
    yield ResetModule()
    answer = yield Ask(b"", Wait.REPLY, boot_s)
    return answer.said is Said.MODE_QUESTION


def _set_and_start(wanted: RadioSettings) -> Procedure[Running]:
    current = (yield from read_settings()).settings
    yield from write_settings(wanted, current)
    yield from start()
    return Running(wanted)


def restart(wanted: RadioSettings) -> Procedure[Running]:
    """What `bring_up` does with a module that has just asked for the mode."""
    yield from _choose_processor()
    return (yield from _set_and_start(wanted))


def enter_configuration(baud_rate: int, boot_s: float = BOOT_S) -> Procedure[Found]:
    """Bring a module in whatever state to take commands; returns what it was doing.

    From operation this sets the boot mode in its flash memory to configuration, and then has it reset: by its pin,
    or by a user at the power switch, for whom `boot_s` leaves time.
    """
    found = yield from find((baud_rate,))
    if found.mode is Mode.QUESTION:
        yield from _choose_processor()
    elif found.mode is not Mode.PROCESSOR:
        yield from _enter_by_reset(found, True, boot_s)
    return found


def _enter_by_reset(found: Found, can_reset: bool, boot_s: float = BOOT_S) -> Procedure[None]:
    if found.mode in {Mode.BINARY, Mode.ASCII}:
        yield from ask_for_configuration()
    if not can_reset:
        raise DialogueError(f"the module {found.mode.value}. Switch its power off and on again")
    if not (yield from _asks_after_reset(boot_s)):
        raise DialogueError(f"the module has not been reset within {boot_s:g} s")
    yield from _choose_processor()


def ask_for_configuration() -> Procedure[None]:
    """The word that makes a module in operation begin in configuration from its next reset on; it does not answer.

    In binary it takes the word only where a zero follows in its buffer: a half frame of zeros, forgotten after half
    a second, leaves it there. In ASCII the zeros make an empty line.
    """
    yield Ask(b"\x00" * 8 + b"\r\n", Wait.QUIET, _HALF_FRAME_S)
    yield Ask(_CONFIGURATION_WORD + b"\r\n", Wait.QUIET, _WORD_S)


def _choose_processor() -> Procedure[None]:
    for _ in range(_TRIES):
        answer = yield Ask(b"processor\r\n", Wait.REPLY, _ANSWER_S)
        if answer.said is Said.OK or (answer.said, answer.refusal) == (Said.REFUSED, 1):  # already there
            return
    raise DialogueError(f"the module asks for its mode and does not take the answer. {_LINE}")


def read_settings() -> Procedure[Shown]:
    for _ in range(_TRIES):
        answer = yield Ask(b"show\r\n", Wait.SHOW, 2.0)
        if answer.said is Said.TEXT:
            try:
                return parse_show(answer.text)
            except SettingsError as error:
                problem = str(error)
        else:
            problem = f"`show` was answered by {answer.said.value}"
    raise DialogueError(f"{problem}. {_LINE}")


def write_settings(wanted: RadioSettings, current: RadioSettings | None) -> Procedure[int]:
    """Set what differs, in memory alone; returns how many settings that were."""
    needed = commands(wanted, current)
    for command in needed:
        yield from _set(command)
    return len(needed)


def _set(command: Command) -> Procedure[None]:
    answer = yield from _insist(command.text.encode("ascii"))
    if answer.said is Said.REFUSED:
        reason = _REFUSALS.get(answer.refusal, f"NG {answer.refusal:03d}")
        raise DialogueError(f"the module refuses `{command.text}`: {reason}")
    if command.new_baud_rate is not None:
        yield SetBaudRate(command.new_baud_rate)
        yield Ask(b"\r\n", Wait.REPLY, _ANSWER_S)  # an empty line is refused, which ends garbled bytes


def save() -> Procedure[None]:
    """Write the settings to the flash memory."""
    answer = yield Ask(b"save\r\n", Wait.REPLY, _FLASH_S)
    if answer.said is Said.REFUSED:
        raise DialogueError(f"not saved: {_REFUSALS.get(answer.refusal, f'NG {answer.refusal:03d}')}")
    if answer.said is not Said.OK:
        raise DialogueError(f"not saved: the module does not answer. {_LINE}")


def load_defaults() -> Procedure[None]:
    """Set what the factory has set, in memory; the module speaks at 115200 baud at once."""
    answer = yield Ask(b"load\r\n", Wait.REPLY, _FLASH_S)
    if answer.said is Said.REFUSED:
        raise DialogueError(f"the module refuses `load`: NG {answer.refusal:03d}")
    yield SetBaudRate(RadioSettings().baud_rate)
    yield Ask(b"\r\n", Wait.REPLY, _ANSWER_S)


def version() -> Procedure[str]:
    answer = yield Ask(b"version\r\n", Wait.VERSION, 1.0)
    if answer.said is not Said.TEXT:
        raise DialogueError(f"the module does not say its version. {_LINE}")
    return answer.text


def start() -> Procedure[None]:
    """Leave configuration and operate."""
    answer = yield from _insist(b"start")
    if answer.said is not Said.OK:
        raise DialogueError(f"the module does not start to operate. {_LINE}")
    yield Ask(b"", Wait.QUIET, 0.05)  # its empty line


def _insist(line: bytes) -> Procedure[Answer]:
    """Say a line until it is answered; half answers and silence are a reason to say it again."""
    for _ in range(_TRIES):
        answer = yield Ask(line + b"\r\n", Wait.REPLY, _ANSWER_S)
        if answer.said in {Said.OK, Said.REFUSED}:
            return answer
        if answer.said is Said.MODE_QUESTION:
            raise DialogueError(
                "the module has restarted while it was being configured. Is its supply strong enough? Try again"
            )
    raise DialogueError(f"no answer to `{line.decode('ascii')}`. {_LINE}")


def _ask(data: bytes, wait: Wait, baud_rate: int) -> Ask:
    return Ask(data, wait, _ANSWER_S + 10 * (len(data) + 50) / baud_rate)


def require_usable(settings: RadioSettings) -> None:
    """Raises `SettingsError` for settings with which the driver cannot tell a reply from a packet."""
    needed = (
        (settings.format is Format.BINARY, "format=binary: in ASCII a packet that says OK is taken for a reply"),
        (settings.show_rssi, "show_rssi=true: without it short packets are taken for replies"),
        (settings.show_sender, "show_sender=true: without it short packets are taken for replies"),
        (settings.transfer is Transfer.PAYLOAD, "transfer=payload: the partner is always the same"),
        (settings.sleep is Sleep.NONE, "sleep=none: a module that sleeps hears nothing"),
        (settings.auto_send_interval_s == 0, "auto_send_interval_s=0: its replies belong to no packet of ours"),
    )
    for fulfilled, text in needed:
        if not fulfilled:
            raise SettingsError(f"the link needs {text}")
