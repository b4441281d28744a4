"""The radio half of an ES920LR: carrier sense, packets, acknowledgements and retries, as firmware 1.12 has them.

Its known faults are part of it: a packet whose acknowledgement is lost is delivered twice; one that comes while a
send is pending is acknowledged and thrown away; one whose acknowledgement finds the channel busy is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from shared.link.es920lr.airtime import (
    CARRIER_SENSE_TRIES,
    PAUSE_S,
    ack_airtime_s,
    ack_timeout_s,
    airtime_s,
    sense_s,
    sense_wait_s,
)
from shared.link.es920lr.settings import BROADCAST_ID, RadioSettings
from tools.simulator.radio.channel import Antenna, RadioChannel, RadioFrame, Transmission, Tuning
from tools.simulator.radio.timeline import Entry, Timeline

_BUSY_DBM = -90.0
_STUCK_MARGIN_S = 0.1
CHANNEL_BUSY, NO_ACKNOWLEDGEMENT, STUCK = 102, 103, 104


@dataclass(slots=True)
class MacStatistics:
    packets: int = 0
    acknowledgements: int = 0
    delivered: int = 0
    dropped_while_sending: int = 0
    lost_without_acknowledgement: int = 0  # the channel was busy when the acknowledgement was due


class Mac:
    """`deliver` gets packets for this module; `done` gets None or the number of the NG when a send has ended.

    `occupy` is told for how long the processor does nothing but listen to the carrier.
    """

    def __init__(
        self,
        timeline: Timeline,
        channel: RadioChannel,
        antenna: Antenna,
        deliver: Callable[[RadioFrame, float], None],
        done: Callable[[int | None], None],
        occupy: Callable[[float], None],
    ) -> None:
        self.statistics = MacStatistics()
        self.carrier_sense = True  # False takes no time for it: for comparison with figures that leave it out
        self.is_stuck = False  # a transmitter that never finishes
        self._timeline = timeline
        self._channel = channel
        self._antenna = antenna
        self._deliver = deliver
        self._done = done
        self._occupy = occupy
        self._settings = RadioSettings()
        self._due: set[Entry] = set()
        self._on_air: Transmission | None = None
        self._sequence = 0
        self._sending: RadioFrame | None = None
        self._acknowledged = False
        self._paused = False
        self._ack_is_late = False
        self._attempt = 0

    @property
    def is_sending(self) -> bool:
        return self._sending is not None

    def start(self, settings: RadioSettings) -> None:
        self.stop()
        self._settings = settings
        self._listen()

    def stop(self) -> None:
        """Nothing is sent, nothing heard: asleep or without power."""
        self._abort()
        self._sending = None
        self._antenna.deafen()

    def send(self, payload: bytes, pan_id: int, destination_id: int) -> None:
        """Begin to send; the caller has made sure that nothing is pending. It breaks off an acknowledgement."""
        if self._due or self._on_air is not None:
            self.statistics.lost_without_acknowledgement += 1
            self._abort()
        s = self._settings
        wants_ack = s.acknowledge and destination_id != BROADCAST_ID
        frame = RadioFrame(pan_id, destination_id, s.own_id, self._sequence, wants_ack=wants_ack, payload=payload)
        self._sending = frame
        self._acknowledged = self._paused = self._ack_is_late = False
        self._attempt = 0
        self._sense(lambda free: self._first_attempt(frame, free))

    def heard(self, frame: RadioFrame, power_dbm: float) -> None:
        """The antenna has received a packet."""
        s = self._settings
        if frame.pan_id != s.pan_id:
            return
        if frame.is_ack:
            expected = self._sending
            if expected is not None and frame.destination_id == s.own_id and frame.sequence == expected.sequence:
                self._acknowledged = True
                self._finish_if_over()
        elif frame.destination_id == BROADCAST_ID or (frame.destination_id == s.own_id and not frame.wants_ack):
            self._hand_over(frame, power_dbm)
        elif frame.destination_id == s.own_id:
            self._sense(lambda free: self._acknowledge(frame, power_dbm, free))

    def _acknowledge(self, frame: RadioFrame, power_dbm: float, free: bool) -> None:
        if not free:
            self.statistics.lost_without_acknowledgement += 1
            self._listen()
            return
        ack = RadioFrame(self._settings.pan_id, frame.source_id, self._settings.own_id, frame.sequence, is_ack=True)
        self.statistics.acknowledgements += 1
        took_s = ack_airtime_s(self._settings.modulation)
        self._transmit(ack, took_s, lambda: self._hand_over(frame, power_dbm))

    def _hand_over(self, frame: RadioFrame, power_dbm: float) -> None:
        if self._sending is not None:  # and the radio is not set to listen again before that is over
            self.statistics.dropped_while_sending += 1
            return
        self.statistics.delivered += 1
        self._deliver(frame, power_dbm)
        self._listen()

    def _first_attempt(self, frame: RadioFrame, free: bool) -> None:
        if not free:
            self._end(CHANNEL_BUSY)
            return
        self._sequence = (self._sequence + 1) & 0xFF
        if self.is_stuck:
            self._later(_STUCK_MARGIN_S + self._airtime_s(frame), lambda: self._end(STUCK))
            self._antenna.deafen()
            return
        self._put_on_air(frame)

    def _next_attempt(self, frame: RadioFrame, free: bool) -> None:
        if free:
            self._put_on_air(frame)
        else:
            self._end(NO_ACKNOWLEDGEMENT)

    def _put_on_air(self, frame: RadioFrame) -> None:
        self.statistics.packets += 1
        self._transmit(frame, self._airtime_s(frame), lambda: self._sent(frame))

    def _sent(self, frame: RadioFrame) -> None:
        self._later(PAUSE_S, self._pause_over)
        if frame.wants_ack:
            self._listen()
            self._later(ack_timeout_s(self._settings.modulation), self._ack_late)
        else:
            self._acknowledged = True

    def _pause_over(self) -> None:
        self._paused = True
        self._finish_if_over()

    def _ack_late(self) -> None:
        self._ack_is_late = True
        self._finish_if_over()

    def _finish_if_over(self) -> None:
        frame = self._sending
        if frame is None or not self._paused:
            return
        if self._acknowledged:
            self._end(None)
        elif self._ack_is_late:
            self._paused = self._ack_is_late = False
            self._attempt += 1
            if self._attempt > self._settings.retries:
                self._end(NO_ACKNOWLEDGEMENT)
            else:
                self._sense(lambda free: self._next_attempt(frame, free))

    def _end(self, refusal: int | None) -> None:
        self._sending = None
        self._abort()
        self._listen()
        self._done(refusal)

    def _sense(self, then: Callable[[bool], None]) -> None:
        """Two good readings one after the other, or three bad ones."""
        self._antenna.deafen()
        if self.carrier_sense:
            self._read_carrier(then, good=0, bad=0, first=True)
        else:
            then(True)

    def _read_carrier(self, then: Callable[[bool], None], good: int, bad: int, first: bool) -> None:
        bandwidth_hz = self._settings.bandwidth_hz
        wait_s = 0.0 if first else sense_wait_s(bandwidth_hz)
        took_s = wait_s + sense_s(bandwidth_hz)

        def read() -> None:
            now_s = self._timeline.now_s
            tuning = self._tuning()
            power_dbm = self._channel.strongest_dbm(self._antenna, tuning, now_s - sense_s(bandwidth_hz), now_s)
            if power_dbm >= _BUSY_DBM:
                self._judge(then, 0, bad + 1)
            else:
                self._judge(then, good + 1, bad)

        self._later(took_s, read)
        self._occupy(took_s)  # after it, so that one reading follows the other without a byte taken in between

    def _judge(self, then: Callable[[bool], None], good: int, bad: int) -> None:
        if good == 2 or bad == CARRIER_SENSE_TRIES:
            then(good == 2)
        else:
            self._read_carrier(then, good, bad, first=False)

    def _transmit(self, frame: RadioFrame, took_s: float, then: Callable[[], None]) -> None:
        def over() -> None:
            self._on_air = None
            then()

        if self._on_air is not None:
            self._channel.cut_short(self._on_air)
        self._antenna.tuning = self._tuning()
        power_dbm = float(self._settings.power_dbm)
        self._on_air = self._channel.transmit(self._antenna, frame, power_dbm, took_s, over)

    def _listen(self) -> None:
        self._antenna.listen(self._tuning(), self._timeline.now_s)

    def _tuning(self) -> Tuning:
        return Tuning(self._settings.frequency_hz, self._settings.modulation)

    def _airtime_s(self, frame: RadioFrame) -> float:
        return airtime_s(self._settings.modulation, len(frame.payload))

    def _later(self, delay_s: float, action: Callable[[], None]) -> None:
        def act() -> None:
            self._due.discard(entry)
            action()

        entry = self._timeline.after(delay_s, act)
        self._due.add(entry)

    def _abort(self) -> None:
        for entry in self._due:
            entry.cancel()
        self._due.clear()
        if self._on_air is not None:
            self._channel.cut_short(self._on_air)
            self._on_air = None
