"""The ES920LR on a byte port, without a thread of its own: call `poll` often, it waits for bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from shared.link.base import LinkError
from shared.link.byte_port import BytePort
from shared.link.es920lr.band import LONG_CARRIER_SENSE, BandRule
from shared.link.es920lr.core import Es920lrCore, Event, RadioStatistics
from shared.link.es920lr.dialogue import Ask, Dialogue, DialogueError, Procedure, SetBaudRate, Step
from shared.link.es920lr.settings import RadioSettings
from shared.runtime.clock import Clock

T = TypeVar("T")
Reset = Callable[[], None]


class Es920lr:
    """Brings the module up by itself, now and whenever it has lost its power.

    The port is the driver's until `close`. All calls are made from one thread.
    """

    def __init__(
        self,
        port: BytePort,
        settings: RadioSettings,
        clock: Clock,
        rule: BandRule = LONG_CARRIER_SENSE,
        reset: Reset | None = None,
    ) -> None:
        """`reset` pulses the module's reset pin, where one is wired. Raises `SettingsError`, `LinkError`."""
        if not port.set_baud_rate(settings.baud_rate):
            raise LinkError(f"{port.name}: has no {settings.baud_rate} baud; take another baud_rate for the module")
        self._port = port
        self._clock = clock
        self._reset = reset
        self._core = Es920lrCore(settings, rule, reset is not None, clock.now_s())

    @property
    def name(self) -> str:
        return self._port.name

    @property
    def settings(self) -> RadioSettings:
        return self._core.settings

    @property
    def statistics(self) -> RadioStatistics:
        return self._core.statistics

    @property
    def operating(self) -> bool:
        return self._core.operating

    @property
    def busy(self) -> bool:
        """A packet is on its way, or its pause has not passed: the module hears nothing meanwhile."""
        return self._core.busy

    @property
    def can_submit(self) -> bool:
        """There is room for a packet: for the next one also while another is on its way."""
        return self._core.can_submit

    def submit(self, payload: bytes) -> int | None:
        """Begin to send 1 to 50 bytes; `poll` will tell their fate under this handle. None while there is no room.

        Raises `LinkError` when the port is lost, `ValueError` for what fits in no packet or the band does not allow.
        """
        handle = self._core.submit(payload, self._clock.now_s())
        self._carry_out()
        return handle

    def poll(self, timeout_s: float) -> list[Event]:
        """What has happened, as soon as anything has; empty when nothing did in time. Raises `LinkError`."""
        until_s = self._clock.now_s() + timeout_s
        while True:
            self._carry_out()
            now_s = self._clock.now_s()
            wait_s = min(until_s, self._core.next_tick_s(now_s)) - now_s
            data = self._port.read(max(0.0, wait_s))
            now_s = self._clock.now_s()
            if data:
                self._core.feed(data, now_s)
            else:
                self._core.tick(now_s)
            self._carry_out()
            events = self._core.take_events()
            if events or now_s >= until_s:
                return events

    def wait_until_operating(self, timeout_s: float) -> list[Event]:
        """The events until then. Raises `LinkError` when the module does not operate in time."""
        until_s = self._clock.now_s() + timeout_s
        events: list[Event] = []
        while not self.operating:
            if (left_s := until_s - self._clock.now_s()) <= 0:
                raise LinkError(f"{self.name}: the radio module does not operate after {timeout_s:g} s")
            events += self.poll(left_s)
        return events

    def close(self) -> None:
        """Let go of the port; the module goes on listening."""
        self._port.close()

    def _carry_out(self) -> None:
        for step in self._core.take_steps():
            carry_out(step, self._port, self._reset)


def carry_out(step: Step, port: BytePort, reset: Reset | None) -> None:
    match step:
        case Ask():
            if step.data:
                port.write(step.data)
        case SetBaudRate():
            port.set_baud_rate(step.baud_rate)
        case _:
            if reset is not None:
                reset()


def converse(port: BytePort, procedure: Procedure[T], clock: Clock, reset: Reset | None = None) -> T:
    """Run a procedure to its end and return its result. Raises `LinkError`, which names the port."""
    try:
        dialogue = Dialogue(procedure, clock.now_s())
        while True:
            steps, dialogue.steps = dialogue.steps, []
            for step in steps:
                carry_out(step, port, reset)
            if dialogue.finished:
                return dialogue.result
            data = port.read(max(0.0, dialogue.deadline_s - clock.now_s()))
            dialogue.feed(data, clock.now_s())
            dialogue.tick(clock.now_s())
    except DialogueError as error:
        raise LinkError(f"{port.name}: {error}") from error
