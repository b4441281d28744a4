"""The host's side of the talk with the transceiver, sans-I/O: bytes and time in, bytes and radio streams out.

The host says nothing before it has heard the firmware, and falls silent when it hears nothing for 0.35 s: the Mega's
boot loader stays for as long as bytes come in. A session that ended, by a reset of the Mega or by silence, is begun
again by itself; the bytes that were under way are lost, and `generation` tells.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from enum import Enum

from shared.protocol import transceiver as t
from shared.protocol.transceiver_frame import FrameReader, encode
from shared.protocol.transceiver_stream import FromRadio, ToRadio

_MAX_TAG = 255
_MAX_COMMANDS = 16


class State(Enum):
    SILENT = "has not been heard"
    GREETING = "is being greeted"
    OPEN = "open"
    REFUSED = "speaks another version of the protocol"


@dataclass(slots=True, eq=False)
class Command:
    """A request on its way; `result` is None until the transceiver has answered, `lost` when it never will."""

    frame: t.SetBaud | t.ResetRadio
    result: t.Result | None = None
    lost: bool = False

    @property
    def finished(self) -> bool:
        return self.lost or self.result is not None


@dataclass(slots=True)
class TransceiverHealth:
    """What the transceiver last said of itself, and what the host has seen of it."""

    firmware: tuple[int, int] | None = None
    reset_cause: t.ResetCause = t.ResetCause.POWER_ON
    reset_detail: int = 0
    board: t.Health | None = None
    radios: list[t.RadioHealth | None] = field(default_factory=lambda: [None] * t.RADIOS)
    sessions: int = 0
    losses: int = 0
    bad_frames: int = 0
    resent_bytes: int = 0

    def copy(self) -> TransceiverHealth:
        return replace(self, radios=list(self.radios))


class TransceiverSession:
    """Call `feed` with what came, `tick` at least every 20 ms, and send what `take_output` gives."""

    def __init__(self, first_session: int, bauds: tuple[int, ...] = (t.DEFAULT_RADIO_BAUD,) * t.RADIOS) -> None:
        """`first_session`: a number that the last host did not use, such as the time."""
        self.state = State.SILENT
        self.generation = 0  # grows with every loss
        self.health = TransceiverHealth()
        self.trouble = "nothing has been heard of it"
        self.faults: deque[t.FaultReport] = deque(maxlen=32)
        self._session = first_session & 0xFFFFFFFF
        self._bauds = list(bauds)
        self._reader = FrameReader()
        self._output = bytearray()
        self._tag = 0
        self._clear()
        self._heard_s = self._greeted_s = self._pinged_s = self._asked_s = self._commanded_s = -10.0

    @property
    def is_up(self) -> bool:
        """A session is open and both radios' ports have the rates they should."""
        return self.state is State.OPEN and not self._setting_up

    # ---- the radios' side

    def write(self, radio: int, data: bytes) -> int:
        """Take what there is room for; how many bytes that is."""
        return self._to[radio].write(data[: self.room(radio)])

    def read(self, radio: int) -> bytes:
        return self._from[radio].read()

    def room(self, radio: int) -> int:
        """Bytes that `write` would take; none while the rate changes, which separates old bytes from new."""
        changes = any(isinstance(c.frame, t.SetBaud) and c.frame.radio == radio for c in self._commands)
        return 0 if changes else self._to[radio].room

    def has_arrived(self, radio: int) -> bool:
        return not self._from[radio].is_empty

    def set_baud(self, radio: int, baud: int) -> Command:
        """The rate from now on, also after a reset of the Mega, once all that was written before is out."""
        self._bauds[radio] = baud
        return self._command(t.SetBaud(self._next_tag(), radio, baud))

    def reset_radio(self, radio: int, low_ms: int) -> Command:
        return self._command(t.ResetRadio(self._next_tag(), radio, low_ms))

    # ---- the wire's side

    def take_output(self) -> bytes:
        output = bytes(self._output)
        self._output.clear()
        return output

    def feed(self, data: bytes, now_s: float) -> None:
        for frame in self._reader.feed(data):
            self._heard_s = now_s
            self._on_frame(frame, now_s)
        self.health.bad_frames = self._reader.bad_frames
        self.tick(now_s)

    def tick(self, now_s: float) -> None:
        silent_s = now_s - self._heard_s
        if self.state is not State.SILENT and silent_s >= t.SESSION_TIMEOUT_MS / 1_000:
            self._lose("nothing was heard of it for 1.5 s", State.SILENT)
        elif silent_s >= t.QUIET_AFTER_MS / 1_000:
            return
        if self.state is State.GREETING and now_s - self._greeted_s >= t.COMMAND_RETRY_MS / 1_000:
            self._greet(now_s)
        if self.state is State.OPEN:
            self._tick_open(now_s)

    def unplug(self, trouble: str) -> None:
        """The wire is gone, and with it what was half said on it."""
        self._lose(trouble, State.SILENT)
        self._output.clear()
        self._reader.feed(b"\0")

    def close(self) -> None:
        """Say goodbye; `take_output` has it."""
        if self.state is State.OPEN:
            self._send(t.Goodbye())
        self._lose("it was closed", State.SILENT)

    # ---- inside

    def _clear(self) -> None:
        self._to = [ToRadio(radio) for radio in range(t.RADIOS)]
        self._from = [FromRadio(radio) for radio in range(t.RADIOS)]
        self._commands: deque[Command] = deque()
        self._setting_up: list[Command] = []

    def _send(self, frame: t.Frame) -> None:
        self._output += encode(frame)

    def _next_tag(self) -> int:
        self._tag = self._tag % _MAX_TAG + 1
        return self._tag

    def _command(self, frame: t.SetBaud | t.ResetRadio) -> Command:
        command = Command(frame)
        if self.state is State.OPEN and len(self._commands) < _MAX_COMMANDS:
            self._commands.append(command)
        else:
            command.lost = True
        return command

    def _lose(self, trouble: str, state: State) -> None:
        if self.state is State.OPEN:
            self.health.losses += 1
            self.generation += 1
        for command in self._commands:
            command.lost = True
        self._clear()
        self.trouble = trouble
        self.state = state

    def _greet(self, now_s: float) -> None:
        self._greeted_s = now_s
        self._output += b"\0"  # ends whatever an earlier host left half said
        self._send(t.Hello(t.FINGERPRINT, self._session))

    def _on_frame(self, frame: t.Frame, now_s: float) -> None:
        match frame:
            case t.Announce():
                self._on_announce(frame, now_s)
            case t.Refuse():
                self._refuse(frame.fingerprint)
            case t.Welcome():
                self._on_welcome(frame, now_s)
            case _ if self.state is State.OPEN:
                self._on_session_frame(frame, now_s)
            case _ if self.state is State.SILENT:
                self._begin_greeting(now_s)
            case _:
                pass

    def _begin_greeting(self, now_s: float) -> None:
        self._session = self._session % 0xFFFFFFFF + 1
        self.state = State.GREETING
        self._greet(now_s)

    def _on_announce(self, frame: t.Announce, now_s: float) -> None:
        self._note(frame)
        if frame.fingerprint != t.FINGERPRINT:
            self._refuse(frame.fingerprint)
        elif self.state is not State.GREETING:
            self._lose(f"it began anew: {describe_reset(self.health)}", State.SILENT)
            self._begin_greeting(now_s)

    def _note(self, frame: t.Announce | t.Welcome) -> None:
        """Which firmware it is and why it began."""
        self.health.firmware = (frame.major, frame.minor)
        self.health.reset_detail = frame.reset_detail
        self.health.reset_cause = (
            t.ResetCause(frame.reset_cause) if frame.reset_cause < len(t.ResetCause) else t.ResetCause.BAD_INTERRUPT
        )

    def _refuse(self, fingerprint: int) -> None:
        self._lose(
            f"its firmware speaks protocol {fingerprint:04x}, this program {t.FINGERPRINT:04x}: "
            "run `make flash-transceiver`",
            State.REFUSED,
        )

    def _on_welcome(self, frame: t.Welcome, now_s: float) -> None:
        if self.state is not State.GREETING or frame.session != self._session:
            return
        self.state = State.OPEN
        self._note(frame)
        self.health.sessions += 1
        self._tag = 0  # the firmware has forgotten the tags of the last session
        self._pinged_s = self._asked_s = self._commanded_s = -10.0
        self._setting_up = [self.set_baud(radio, baud) for radio, baud in enumerate(self._bauds)]
        self._tick_open(now_s)

    def _on_session_frame(self, frame: t.Frame, now_s: float) -> None:
        match frame:
            case t.Data() if frame.radio < t.RADIOS:
                self._from[frame.radio].receive(frame)
            case t.Acknowledge() if frame.radio < t.RADIOS:
                self._to[frame.radio].acknowledge(frame, now_s)
            case t.Done():
                self._on_done(frame)
            case t.Health():
                self.health.board = frame
            case t.RadioHealth() if frame.radio < t.RADIOS:
                self.health.radios[frame.radio] = frame
            case t.FaultReport() if frame.fault < len(t.Fault) and frame.port < len(t.Port):
                self.faults.append(frame)
            case _:
                pass

    def _on_done(self, frame: t.Done) -> None:
        if not self._commands or self._commands[0].frame.tag != frame.tag:
            return
        command = self._commands.popleft()
        command.result = t.Result.DONE if frame.result == t.Result.DONE else t.Result.BAD_VALUE
        self._commanded_s = -10.0
        if command in self._setting_up:
            self._setting_up.remove(command)

    def _tick_open(self, now_s: float) -> None:
        pings = now_s - self._pinged_s >= t.PING_EVERY_MS / 1_000
        if pings:
            self._ping(now_s)
        for stream in self._from:
            if (frame := stream.acknowledgement(always=pings)) is not None:
                self._send(frame)
        self._tick_commands(now_s)
        for to_radio in self._to:
            for data in to_radio.frames(now_s):
                self._send(data)
        self.health.resent_bytes = sum(stream.resent_bytes for stream in self._to)

    def _ping(self, now_s: float) -> None:
        self._pinged_s = now_s
        wants_health = now_s - self._asked_s >= t.HEALTH_EVERY_MS / 1_000
        if wants_health:
            self._asked_s = now_s
        self._send(t.Ping(int(wants_health)))

    def _tick_commands(self, now_s: float) -> None:
        if not self._commands or now_s - self._commanded_s < t.COMMAND_RETRY_MS / 1_000:
            return
        frame = self._commands[0].frame
        if isinstance(frame, t.SetBaud) and not self._to[frame.radio].is_empty:
            return  # what was written before goes out at the old rate
        self._commanded_s = now_s
        self._send(frame)


_FAULTS = {
    t.Fault.FRAMING: "bytes without a stop bit",
    t.Fault.OVERRUN: "bytes lost in the chip",
    t.Fault.RING_FULL: "bytes lost by a busy firmware",
    t.Fault.STREAM_FULL: "bytes lost because this program did not fetch them",
    t.Fault.BAD_FRAME: "damaged frames",
}


def describe_fault(report: t.FaultReport) -> str:
    """What went wrong and where, in words."""
    fault = _FAULTS[t.Fault(report.fault)]
    return f"{fault} at {t.Port(report.port).name}"


_CAUSES = {
    t.ResetCause.POWER_ON: "power came",
    t.ResetCause.RESET_PIN: "its reset was pulled",
    t.ResetCause.BROWN_OUT: "its supply sagged",
    t.ResetCause.STACK_OVERFLOW: "its stack overflowed",
    t.ResetCause.BAD_INTERRUPT: "an interrupt came that it does not know",
}


def describe_reset(health: TransceiverHealth) -> str:
    """Why the firmware began, in words."""
    detail = health.reset_detail
    if health.reset_cause is t.ResetCause.HUNG:
        return f"the watchdog bit in task {t.Task(detail).name if detail < len(t.Task) else detail}"
    if health.reset_cause is t.ResetCause.RING_STUCK:
        way = "sending" if detail % 2 else "receiving"
        port = t.Port(detail // 2).name if detail // 2 < len(t.Port) else str(detail // 2)
        return f"the {way} ring of {port} stood still"
    return _CAUSES[health.reset_cause]
