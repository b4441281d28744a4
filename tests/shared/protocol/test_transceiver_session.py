"""The host's side of the talk with the transceiver, and its streams, without a firmware."""

from __future__ import annotations

import pytest

from shared.protocol import transceiver as t
from shared.protocol.transceiver_frame import FrameReader, encode
from shared.protocol.transceiver_session import State, TransceiverSession, describe_reset
from shared.protocol.transceiver_stream import FROM_RADIO_BYTES, TO_RADIO_BYTES, FromRadio, ToRadio

ANNOUNCE = t.Announce(t.FINGERPRINT, 1, 0, t.ResetCause.POWER_ON, 0)


class Talk:
    """A session whose other side is the test."""

    def __init__(self) -> None:
        self.session = TransceiverSession(first_session=41)
        self.now_s = 0.0
        self._reader = FrameReader()

    def say(self, *frames: t.Frame) -> list[t.Frame]:
        self.session.feed(b"".join(map(encode, frames)), self.now_s)
        return self.heard()

    def wait(self, seconds: float) -> list[t.Frame]:
        self.now_s += seconds
        self.session.tick(self.now_s)
        return self.heard()

    def heard(self) -> list[t.Frame]:
        return self._reader.feed(self.session.take_output())

    def open(self) -> None:
        (hello,) = self.say(ANNOUNCE)
        assert isinstance(hello, t.Hello)
        commands = [f for f in self.say(t.Welcome(hello.session, *t.VERSION, 0, 0)) if isinstance(f, t.SetBaud)]
        while commands:
            commands = [f for f in self.say(t.Done(commands[0].tag, 0)) if isinstance(f, t.SetBaud)]
        assert self.session.is_up


@pytest.fixture
def talk() -> Talk:
    return Talk()


def test_it_says_nothing_before_it_has_heard_the_firmware(talk: Talk) -> None:
    assert [talk.wait(0.1) for _ in range(100)] == [[]] * 100


def test_it_greets_until_it_is_welcomed_and_sets_both_rates(talk: Talk) -> None:
    assert talk.say(ANNOUNCE) == [t.Hello(t.FINGERPRINT, 42)]
    assert talk.wait(0.1) == []
    assert talk.wait(0.15) == [t.Hello(t.FINGERPRINT, 42)]
    assert talk.say(t.Welcome(41, *t.VERSION, 0, 0)) == []
    frames = talk.say(t.Welcome(42, *t.VERSION, t.ResetCause.RESET_PIN, 0))
    assert t.Ping(1) in frames
    assert t.SetBaud(1, 0, 115_200) in frames
    assert t.SetBaud(2, 1, 115_200) in talk.say(t.Done(1, 0))
    assert not talk.session.is_up
    talk.say(t.Done(2, 0))
    assert talk.session.is_up


def test_it_falls_silent_when_it_hears_nothing(talk: Talk) -> None:
    talk.open()
    talk.session.write(0, bytes(100))
    talk.say(t.Acknowledge(0, 0, 1_000))
    assert talk.wait(0.2)
    assert talk.wait(0.2) == []
    assert talk.session.is_up
    talk.wait(1.2)
    assert talk.session.state is State.SILENT
    assert talk.session.generation == 1


def test_a_firmware_that_begins_anew_ends_the_session_and_is_greeted(talk: Talk) -> None:
    talk.open()
    waiting = talk.session.reset_radio(0, 100)
    frames = talk.say(t.Announce(t.FINGERPRINT, 1, 0, t.ResetCause.HUNG, t.Task.COMMAND))
    assert frames[-1] == t.Hello(t.FINGERPRINT, 43)
    assert waiting.lost
    assert talk.session.trouble == "it began anew: the watchdog bit in task COMMAND"
    assert talk.session.generation == 1


def test_frames_of_an_old_session_are_not_taken_for_those_of_the_new(talk: Talk) -> None:
    talk.say(t.Data(0, 0, b"of yesterday"))
    talk.say(t.Data(0, 12, b"still"))
    talk.say(t.Welcome(42, *t.VERSION, t.ResetCause.RESET_PIN, 0), t.Data(0, 0, b"today"))
    assert talk.session.read(0) == b"today"
    assert talk.session.health.firmware == t.VERSION
    assert talk.session.health.reset_cause is t.ResetCause.RESET_PIN


@pytest.mark.parametrize("frame", [t.Announce(1, 9, 9, 0, 0), t.Refuse(1)])
def test_another_version_is_refused_and_may_be_replaced(talk: Talk, frame: t.Frame) -> None:
    talk.say(frame)
    assert talk.session.state is State.REFUSED
    assert "make flash-transceiver" in talk.session.trouble
    assert [f for f in talk.wait(0.1) if not isinstance(f, t.Hello)] == []
    talk.open()


def test_commands_are_repeated_until_answered_one_after_the_other(talk: Talk) -> None:
    talk.open()
    first, second = talk.session.reset_radio(0, 10), talk.session.reset_radio(1, 10)
    assert first.frame in talk.wait(0.01)
    assert talk.say(t.Ping(0)) == []
    talk.say(t.Done(first.frame.tag + 1, 0))
    assert not second.finished
    assert first.frame in talk.wait(0.2)
    frames = talk.say(t.Done(first.frame.tag, t.Result.BAD_VALUE))
    assert first.result is t.Result.BAD_VALUE
    assert second.frame in frames


def test_a_change_of_rate_waits_for_the_bytes_before_it(talk: Talk) -> None:
    talk.open()
    talk.say(t.Acknowledge(0, 0, 96))
    talk.session.write(0, b"old rate")
    command = talk.session.set_baud(0, 9_600)
    assert command.frame not in talk.wait(0.01)
    assert command.frame in talk.say(t.Acknowledge(0, 8, 104))


def test_nothing_is_taken_at_the_new_rate_before_it_holds(talk: Talk) -> None:
    talk.open()
    command = talk.session.set_baud(0, 9_600)
    assert talk.session.write(0, b"too early") == 0
    assert talk.session.write(1, b"the other") == 9
    talk.wait(0.01)
    talk.say(t.Done(command.frame.tag, 0))
    assert talk.session.write(0, b"now") == 3


def test_commands_while_it_is_away_are_lost_at_once(talk: Talk) -> None:
    assert talk.session.set_baud(0, 9_600).lost
    assert talk.session.set_baud(0, 9_600).finished


def test_goodbye_ends_it(talk: Talk) -> None:
    talk.open()
    talk.session.close()
    assert talk.heard() == [t.Goodbye()]
    assert talk.wait(0.2) == []


@pytest.mark.parametrize("cause", list(t.ResetCause))
@pytest.mark.parametrize("detail", [0, 5, 255])
def test_every_reason_has_words(talk: Talk, cause: t.ResetCause, detail: int) -> None:
    talk.say(t.Announce(t.FINGERPRINT, 1, 0, cause, detail))
    assert describe_reset(talk.session.health)


def test_a_stream_keeps_to_its_window() -> None:
    stream = ToRadio(0)
    assert stream.write(bytes(10_000)) == TO_RADIO_BYTES
    assert stream.frames(0.0) == []
    stream.acknowledge(t.Acknowledge(0, 0, 96), 0.0)
    assert [len(f.data) for f in stream.frames(0.0)] == [64, 32]
    stream.acknowledge(t.Acknowledge(0, 64, 70), 0.01)
    assert stream.frames(0.01) == []


def test_a_stream_sends_again_what_was_not_acknowledged() -> None:
    stream = ToRadio(1)
    stream.write(b"abcdef")
    stream.acknowledge(t.Acknowledge(1, 0, 96), 0.0)
    assert stream.frames(0.0) == [t.Data(1, 0, b"abcdef")]
    stream.acknowledge(t.Acknowledge(1, 2, 98), 0.05)
    assert stream.frames(0.1) == []
    assert stream.frames(0.12) == [t.Data(1, 2, b"cdef")]
    assert stream.resent_bytes == 4
    stream.acknowledge(t.Acknowledge(1, 6, 102), 0.13)
    assert stream.is_empty


def test_a_gap_is_reported_and_filled_at_once_and_once() -> None:
    sender, receiver = ToRadio(0), FromRadio(0)
    sender.write(bytes(range(180)))
    sender.acknowledge(t.Acknowledge(0, 0, 1_000), 0.0)
    first, *behind = sender.frames(0.0)
    reports = []
    for frame in behind:
        receiver.receive(frame)
        reports.append(receiver.acknowledgement(always=False))
    assert [r is not None and r.missing for r in reports] == [1, 1]
    sender.acknowledge(t.Acknowledge(0, 0, 1_000, missing=1), 0.001)
    assert sender.frames(0.001) == [first, *behind]
    sender.acknowledge(t.Acknowledge(0, 0, 1_000, missing=1), 0.002)
    assert sender.frames(0.002) == []


def test_a_stream_goes_on_beyond_65536_bytes() -> None:
    sender, receiver = ToRadio(0), FromRadio(0)
    sent, heard = bytearray(), bytearray()
    while len(sent) < 200_000:
        data = bytes([len(sent) % 251]) * 500
        assert sender.write(data) == 500
        sent += data
        while not sender.is_empty:
            acknowledgement = receiver.acknowledgement(always=True)
            assert acknowledgement is not None
            sender.acknowledge(acknowledgement, 0.0)
            for frame in sender.frames(0.0):
                receiver.receive(frame)
                receiver.receive(frame)
            heard += receiver.read()
    assert heard == sent


def test_an_acknowledgement_of_what_was_never_sent_is_not_believed() -> None:
    stream = ToRadio(0)
    stream.write(b"abc")
    stream.acknowledge(t.Acknowledge(0, 4, 100), 0.0)
    assert not stream.is_empty


def test_a_reader_that_sleeps_bounds_the_stream() -> None:
    stream = FromRadio(0)
    for offset in range(0, 4 * FROM_RADIO_BYTES, 64):
        stream.receive(t.Data(0, offset & 0xFFFF, bytes(64)))
    acknowledgement = stream.acknowledgement(always=True)
    assert acknowledgement is not None
    assert acknowledgement.received == acknowledgement.limit
    assert len(stream.read()) == FROM_RADIO_BYTES
    assert stream.acknowledgement(always=False) is not None
