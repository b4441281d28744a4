"""The firmware's hex on an emulated Mega, and the host's side of the talk."""

from __future__ import annotations

from collections.abc import Callable

from shared.protocol.transceiver_session import TransceiverSession
from tools.simulator.devices.mega import MegaEvent, StepMega

Spoil = Callable[[bytes], bytes]
_STEP_US = 2_000


class Bench:
    """The emulated Mega and the host's session in virtual time; the radios' wires end here."""

    def __init__(self, mega: StepMega) -> None:
        self.mega = mega
        self.session = TransceiverSession(first_session=7)
        self.now_s = mega.run(0).now_us / 1e6
        self.sent = [bytearray(), bytearray()]  # by the host, arrived at the radios
        self.events: list[MegaEvent] = []
        self.usb_bytes = 0
        self.spoil: Spoil = bytes  # what happens on USB to bytes from the host
        self.spoil_back: Spoil = bytes  # and to it

    def step(self, radios: tuple[bytes, bytes] = (b"", b""), us: int = _STEP_US) -> None:
        out = self.mega.run(us, self.spoil(self.session.take_output()), radios)
        self.now_s = out.now_us / 1e6
        self.usb_bytes += len(out.usb)
        self.events += out.events
        for radio, data in enumerate(out.radios):
            self.sent[radio] += data
        if out.usb:
            self.session.feed(self.spoil_back(out.usb), self.now_s)
        self.session.tick(self.now_s)

    def run(self, seconds: float) -> None:
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.step()

    def until(self, condition: Callable[[], object], limit_s: float = 5.0) -> None:
        until_s = self.now_s + limit_s
        while not condition():
            assert self.now_s < until_s, f"not in {limit_s} s: {self.session.state}, {self.session.trouble}"
            self.step()

    def bring_up(self) -> None:
        self.until(lambda: self.session.is_up)
