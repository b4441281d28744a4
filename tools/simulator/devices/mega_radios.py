"""The emulated Mega with emulated radio modules on its wires: by the wall's time, or by a clock that is moved.

The station's own code is above it: `Transceiver` opens `MegaRadios.mega.usb`; in virtual time `VirtualTransceiver`
does the same with the same session and the same hex, without threads.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable

from shared.link.base import LinkError
from shared.link.byte_port import PortStatistics
from shared.protocol import transceiver as t
from shared.protocol.transceiver_session import Command, TransceiverHealth, TransceiverSession
from shared.runtime.clock import ManualClock
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.devices.mega import LiveMega, MegaEvent, StepMega
from tools.simulator.devices.mega_build import MegaFiles

Modules = tuple[EmulatedEs920lr, EmulatedEs920lr]
_SLICE_S = 0.001
_COMMAND_S = 3.0
_WRITE_S = 1.0


def _nominal(baud: int) -> int:
    """The rate that is meant by the one that 16 MHz gives."""
    return min(t.RADIO_BAUDS, key=lambda rate: abs(rate - baud))


class MegaWire:
    """One radio's wire of a live Mega: what `PtyRadios` hangs a module on."""

    def __init__(self, module: EmulatedEs920lr, path: str) -> None:
        self.module = module
        self.path = path
        self.master = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.host_baud_rate = t.DEFAULT_RADIO_BAUD

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self.master)


class MegaRadios:
    """A live Mega and the wires of its two radios, for `PtyRadios(clock, timeline, robots_modules, wires=...)`.

    `on_air` is that object's `do`, known only after it was made.
    """

    def __init__(self, files: MegaFiles, modules: Modules) -> None:
        self.on_air: Callable[[Callable[[], None]], None] = lambda action: action()
        self.wires: tuple[MegaWire, ...] = ()
        self._modules = modules
        self.mega = LiveMega(files, on_event=self._on_event)
        names = self.mega.radio_a, self.mega.radio_b
        self.wires = tuple(MegaWire(module, name) for module, name in zip(modules, names, strict=True))

    def __enter__(self) -> MegaRadios:
        return self

    def __exit__(self, *_: object) -> None:
        self.mega.close()

    def _on_event(self, event: MegaEvent) -> None:
        match event:
            case MegaEvent("baud", (port, baud)) if 0 < port <= len(self.wires):
                self.wires[port - 1].host_baud_rate = _nominal(baud)
            case MegaEvent("resetb", (radio, level)):
                module = self._modules[radio]
                self.on_air(module.power_on if level else module.power_off)
            case _:
                pass


class VirtualTransceiver:
    """The station's transceiver in virtual time: the hex, the host's session, and two modules on one manual clock.

    Each call brings the Mega to the clock's time, in steps of a millisecond. Reads that wait move the clock, unless
    `moves_clock` is False for those who move it themselves. The modules' timeline runs by the same clock.
    """

    def __init__(
        self,
        files: MegaFiles,
        clock: ManualClock,
        run_timeline: Callable[[], None],
        modules: Modules,
        moves_clock: bool = True,
    ) -> None:
        self.mega = StepMega(files)
        self.moves_clock = moves_clock
        self.session = TransceiverSession(first_session=1)
        self.clock = clock
        self.radios = tuple(VirtualRadioPort(self, radio) for radio in range(t.RADIOS))
        self._run_timeline = run_timeline
        self._modules = modules
        self._bauds = [t.DEFAULT_RADIO_BAUD] * t.RADIOS
        self._now_s = clock.now_s()

    def __enter__(self) -> VirtualTransceiver:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def health(self) -> TransceiverHealth:
        return self.session.health.copy()

    def wait_until_up(self, timeout_s: float) -> bool:
        return self.wait(lambda: self.session.is_up, timeout_s)

    def follow(self) -> None:
        """Bring the Mega to the clock's time."""
        while self.clock.now_s() - self._now_s >= 0.5 * _SLICE_S:
            self._slice(min(_SLICE_S, self.clock.now_s() - self._now_s))

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Move the clock until it holds; whether it does."""
        self.follow()
        until_s = self.clock.now_s() + timeout_s
        while not condition() and self.moves_clock and self.clock.now_s() < until_s:
            self.clock.advance(min(_SLICE_S, until_s - self.clock.now_s()))
            self._run_timeline()
            self.follow()
        return condition()

    def close(self) -> None:
        self.mega.close()

    def _slice(self, seconds: float) -> None:
        said = tuple(m.line.read(baud) for m, baud in zip(self._modules, self._bauds, strict=True))
        out = self.mega.run(round(seconds * 1e6), self.session.take_output(), (said[0], said[1]))
        self._now_s += seconds
        for event in out.events:
            self._on_event(event)
        for module, baud, data in zip(self._modules, self._bauds, out.radios, strict=True):
            if data:
                module.line.write(data, baud)
        self.session.feed(out.usb, self._now_s)

    def _on_event(self, event: MegaEvent) -> None:
        match event:
            case MegaEvent("baud", (port, baud)) if port > 0:
                self._bauds[port - 1] = _nominal(baud)
            case MegaEvent("resetb", (radio, level)):
                module = self._modules[radio]
                (module.power_on if level else module.power_off)()
            case _:
                pass


class VirtualRadioPort:
    """One radio's bytes in virtual time: a `BytePort`, and the twin of `RadioPort`."""

    def __init__(self, transceiver: VirtualTransceiver, radio: int) -> None:
        self.name = f"virtual transceiver radio {'AB'[radio]}"
        self.statistics = PortStatistics()
        self._transceiver = transceiver
        self._radio = radio
        self._generation = 0
        self._closed = False

    def write(self, data: bytes) -> None:
        self._check()
        session, rest = self._transceiver.session, data
        while True:
            rest = rest[session.write(self._radio, rest) :]
            if not rest:
                break
            if not self._transceiver.wait(self._has_room, _WRITE_S):
                raise LinkError(f"{self.name}: takes no bytes")
        self.statistics.written_bytes += len(data)

    def read(self, timeout_s: float) -> bytes:
        session = self._transceiver.session
        self._transceiver.wait(lambda: session.has_arrived(self._radio) or self._is_lost(), timeout_s)
        self._check()
        data = session.read(self._radio)
        self.statistics.read_bytes += len(data)
        return data

    def set_baud_rate(self, baud_rate: int) -> bool:
        if baud_rate not in t.RADIO_BAUDS:
            return False
        self._check()
        return self._carried_out(self._transceiver.session.set_baud(self._radio, baud_rate))

    def reset(self, low_s: float = 0.05) -> None:
        self._check()
        low_ms = max(1, min(t.MAX_RESET_MS, round(low_s * 1_000)))
        self._carried_out(self._transceiver.session.reset_radio(self._radio, low_ms))

    def close(self) -> None:
        self._closed = True

    def _carried_out(self, command: Command) -> bool:
        self._transceiver.wait(lambda: command.finished, _COMMAND_S)
        if command.lost:
            raise LinkError(f"{self.name}: the transceiver was lost")
        return command.result is not t.Result.BAD_VALUE

    def _has_room(self) -> bool:
        return self._transceiver.session.room(self._radio) > 0

    def _is_lost(self) -> bool:
        session = self._transceiver.session
        return not session.is_up or session.generation != self._generation

    def _check(self) -> None:
        if self._closed:
            raise LinkError(f"{self.name}: the port is closed")
        if self._is_lost():
            self._generation = self._transceiver.session.generation
            raise LinkError(f"{self.name}: the transceiver was lost: {self._transceiver.session.trouble}")
