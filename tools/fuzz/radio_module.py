"""What may come over the serial line of an ES920LR: its own speech and noise, at any moment of the driver's life."""

from __future__ import annotations

import numpy as np

from shared.link.es920lr.airtime import MAX_PAYLOAD_BYTES
from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.parser import MODE_QUESTION, PREFIX_BYTES, Heard, OperationParser
from shared.link.radio_pair.conversation import Conversation
from shared.link.radio_pair.lanes import Lanes
from shared.protocol.auth import Answerer, Caller
from shared.runtime.clock import ManualClock
from tools.fuzz.base import Verdict, require
from tools.fuzz.foreign import Strangers
from tools.simulator.devices.es920lr import EmulatedEs920lr
from tools.simulator.radio.channel import RadioChannel
from tools.simulator.radio.pair_rig import link_settings
from tools.simulator.radio.ports import EmulatedPort
from tools.simulator.radio.timeline import Timeline

_KEY = bytes(range(32))
_PORTIONS_A_ROUND = 50
_LONGEST_RANDOM = 200
_MOST_HELD_BYTES = PREFIX_BYTES + MAX_PAYLOAD_BYTES + 1
_SILENCES_S = (0.0, 0.001, 0.05, 0.3, 1.0)
_STEP_S = 0.001
_RECOVERS_S = 60.0
_SPEECH = (
    b"\x02OK",
    b"\x06NG 101",
    b"OK\r\n",
    b"NG 002\r\n",
    b"\r\n" + MODE_QUESTION,
    b"LORA > ",
    b"VER 1.12\r\n",
    b"\r\n  Node   : EndDevice\r\n",
    b"\xfc\xfc\xff",
    b"Send Data : \r\n\r\n",
)


class _NoisyPort(EmulatedPort):
    """Also says what is put into `noise`."""

    noise = b""

    def read(self, timeout_s: float) -> bytes:
        noise, self.noise = self.noise, b""
        return super().read(timeout_s) + noise


class RadioModule:
    """Parser and driver, an emulated module at the other end, and the link's seal behind them.

    The wire has no checksum: what noise looks like a packet is heard as one. It must not get past the seal.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._clock = ManualClock()
        self._timeline = Timeline(self._clock)
        settings = link_settings()
        module = EmulatedEs920lr(self._timeline, RadioChannel(self._timeline, rng), "robot", settings)
        module.power_on()
        self._port = _NoisyPort(module, self._timeline)
        self._driver = Es920lr(self._port, settings, self._clock, reset=module.reset)
        self._parser = OperationParser()
        self._strangers = Strangers(rng, _LONGEST_RANDOM)
        self._behind = _with_session(rng)
        self._held_bytes = self._foreign = self._forgeries = 0

    def throw(self) -> int:
        offered = 0
        for _ in range(_PORTIONS_A_ROUND):
            sound = self._speech()
            noise = self._strangers.next(sound) if self._rng.random() < 0.6 else sound
            self._strangers.remember(sound)
            self._foreign += noise != sound
            offered += len(noise)
            self._parse(noise)
            self._drive(noise)
        return offered

    def _speech(self) -> bytes:
        if self._rng.random() < 0.5:
            return _SPEECH[int(self._rng.integers(len(_SPEECH)))]
        packet = b"FFC400010002" + self._rng.bytes(int(self._rng.integers(1, MAX_PAYLOAD_BYTES + 1)))
        return bytes((len(packet),)) + packet

    def _parse(self, noise: bytes) -> None:
        for utterance in self._parser.feed(noise, self._clock.now_s()):
            if isinstance(utterance, Heard):
                self._forgeries += self._behind.hear(utterance.payload) is not None
        held = len(self._parser._buffer)  # noqa: SLF001 - the bound is the point
        require(held <= _MOST_HELD_BYTES, f"the parser holds {held} bytes")
        self._parser.expire(self._clock.now_s())

    def _drive(self, noise: bytes) -> None:
        self._port.noise = noise
        if self._driver.can_submit and self._rng.random() < 0.5:
            self._driver.submit(self._rng.bytes(int(self._rng.integers(1, MAX_PAYLOAD_BYTES + 1))))
        self._driver.poll(0.0)
        self._clock.advance(float(self._rng.choice(_SILENCES_S)))
        self._timeline.run()

    def verdict(self) -> Verdict:
        until_s = self._clock.now_s() + _RECOVERS_S
        while not self._driver.operating and self._clock.now_s() < until_s:
            self._driver.poll(0.0)
            self._clock.advance(_STEP_S)
            self._timeline.run()
        require(self._driver.operating, f"the module does not operate {_RECOVERS_S:g} s after the last noise")
        return Verdict(self._foreign, self._forgeries, self._driver.statistics.sent, 0)


def _with_session(rng: np.random.Generator) -> Conversation:
    """The station's side, that knows its robot."""
    robot = Conversation(Lanes(4_096, 4_096), MAX_PAYLOAD_BYTES, Caller(_KEY, rng.bytes))
    station = Conversation(Lanes(4_096, 4_096), MAX_PAYLOAD_BYTES, Answerer(_KEY, rng.bytes))
    heard = station.hear(robot.call())
    require(heard is not None and heard.answer is not None, "the station does not answer a genuine call")
    return station
