"""The firmware's core, as a library with sanitizers, against the Python side of the protocol."""

from __future__ import annotations

import numpy as np
import pytest

from shared.protocol import transceiver as t
from shared.protocol.transceiver_frame import FrameReader, encode
from tools.simulator.devices.mega_core import Core

USB, RADIO_A, RADIO_B = t.Port


def of_kind(frames: list[t.Frame], kind: type[t.Frame]) -> list[t.Frame]:
    return [frame for frame in frames if isinstance(frame, kind)]


def test_it_announces_itself_until_a_session_begins(core: Core) -> None:
    core.start(t.ResetCause.HUNG, 3)
    core.run(1_000)

    announced = of_kind(core.heard(), t.Announce)

    assert announced
    assert set(announced) == {t.Announce(t.FINGERPRINT, *t.VERSION, t.ResetCause.HUNG, 3)}
    core.open_session()
    core.run(400)
    assert of_kind(core.heard(), t.Announce) == []


def test_it_refuses_a_host_of_another_version(core: Core) -> None:
    core.tell(t.Hello(t.FINGERPRINT ^ 1, 5))
    core.run(1)
    frames = core.heard()
    assert t.Refuse(t.FINGERPRINT) in frames
    assert of_kind(frames, t.Welcome) == []


def test_bytes_for_a_radio_leave_on_its_wire_alone(core: Core) -> None:
    core.open_session()
    core.tell(t.Data(1, 0, b"\0hello\0"))
    core.run(2)
    assert core.leave(RADIO_B) == b"\0hello\0"
    assert core.leave(RADIO_A) == b""
    assert t.Acknowledge(1, 7, 7 + t.WINDOW_BYTES) in core.heard()


def test_a_frame_that_comes_twice_is_taken_once(core: Core) -> None:
    core.open_session()
    core.tell(t.Data(0, 0, b"once"), t.Data(0, 0, b"once"), t.Data(0, 2, b"ce more"))
    core.run(2)
    assert core.leave(RADIO_A) == b"once more"


def test_a_gap_is_not_skipped(core: Core) -> None:
    core.open_session()
    core.tell(t.Data(0, 4, b"late"))
    core.run(2)
    assert core.leave(RADIO_A) == b""
    assert t.Acknowledge(0, 0, t.WINDOW_BYTES, missing=1) in core.heard()


def test_what_has_no_room_is_not_taken(core: Core) -> None:
    core.open_session()
    for offset in range(0, 4 * t.HOST_TO_RADIO_BYTES, 64):
        core.tell(t.Data(0, offset, bytes(64)))
    core.run(1)
    promised = max(f.limit for f in of_kind(core.heard(), t.Acknowledge) if f.radio == 0)
    left = b""
    while data := core.leave(RADIO_A):
        left += data
        core.run(1)
    assert len(left) <= t.HOST_TO_RADIO_BYTES + 255
    assert promised <= len(left) + t.WINDOW_BYTES


def test_bytes_of_a_radio_wait_for_a_pause_and_go_in_one_frame(core: Core) -> None:
    core.open_session()
    core.tell(t.Acknowledge(0, 0, 1_000))
    core.heard()
    core.arrive(RADIO_A, b"abc")
    core.run(1)
    core.arrive(RADIO_A, b"def")
    core.run(0)
    assert of_kind(core.heard(), t.Data) == []
    core.run(3)
    assert of_kind(core.heard(), t.Data) == [t.Data(0, 0, b"abcdef")]


def test_a_radio_that_never_pauses_waits_five_milliseconds_at_most(core: Core) -> None:
    core.open_session()
    core.tell(t.Acknowledge(0, 0, 1_000))
    for _ in range(6):
        core.arrive(RADIO_A, b"x")
        core.run(1)
    assert of_kind(core.heard(), t.Data)


def test_unacknowledged_bytes_are_sent_again(core: Core) -> None:
    core.open_session()
    core.tell(t.Acknowledge(1, 0, 1_000))
    core.arrive(RADIO_B, b"precious")
    core.run(5)
    assert of_kind(core.heard(), t.Data) == [t.Data(1, 0, b"precious")]
    core.run(t.RETRY_AFTER_MS + 5)
    assert of_kind(core.heard(), t.Data) == [t.Data(1, 0, b"precious")]
    core.tell(t.Acknowledge(1, 8, 1_000))
    core.run(2 * t.RETRY_AFTER_MS)
    assert of_kind(core.heard(), t.Data) == []


def test_a_gap_that_the_host_reports_is_filled_at_once_and_once(core: Core) -> None:
    core.open_session()
    core.tell(t.Acknowledge(0, 0, 1_000))
    core.arrive(RADIO_A, b"lost")
    core.run(5)
    core.arrive(RADIO_A, b"and found")
    core.run(5)
    core.heard()
    core.tell(t.Acknowledge(0, 0, 1_000, missing=1), t.Acknowledge(0, 0, 1_000, missing=1))
    core.run(5)
    assert of_kind(core.heard(), t.Data) == [t.Data(0, 0, b"lostand found")]


def test_a_host_without_room_gets_nothing(core: Core) -> None:
    core.open_session()
    core.tell(t.Acknowledge(0, 0, 3))
    core.arrive(RADIO_A, b"abcdef")
    core.run(10)
    assert of_kind(core.heard(), t.Data) == [t.Data(0, 0, b"abc")]


def test_what_a_deaf_host_leaves_is_counted_not_overwritten(core: Core) -> None:
    core.open_session()
    for _ in range(t.RADIO_TO_HOST_BYTES // 64 + 2):
        core.arrive(RADIO_A, bytes(64))
        core.run(3)
    core.tell(t.Ping(1))
    core.run(300)
    frames = core.heard()
    (health,) = [f for f in of_kind(frames, t.RadioHealth) if f.radio == 0]
    assert health.stream_full == 128
    assert health.to_host_high_water == t.RADIO_TO_HOST_BYTES
    assert t.FaultReport(t.Fault.STREAM_FULL, RADIO_A, 128) in frames


def test_health_tells_what_was_counted(core: Core) -> None:
    core.open_session()
    core.arrive(RADIO_A, b"12345")
    core.disturb(RADIO_A, True, False)
    core.disturb(RADIO_B, False, True)
    core.arrive(USB, b"\x05rubbish\0")
    core.tell(t.Data(1, 0, b"abc"))
    core.run(2)
    core.leave(RADIO_B)
    core.run(1)
    core.tell(t.Ping(1))
    core.run(5)
    frames = core.heard()
    (own,) = of_kind(frames, t.Health)
    radio_a, radio_b = of_kind(frames, t.RadioHealth)
    assert (own.usb_bad_frames, own.frames_in, own.usb_ring_full) == (1, 3, 0)
    assert (radio_a.bytes_in, radio_a.framing, radio_a.overrun) == (5, 1, 0)
    assert (radio_b.bytes_out, radio_b.framing, radio_b.overrun) == (3, 0, 1)


def test_a_silent_host_ends_the_session(core: Core) -> None:
    core.open_session()
    core.run(t.SESSION_TIMEOUT_MS + 10)
    assert of_kind(core.heard(), t.Announce)
    core.tell(t.Data(0, 0, b"too late"))
    core.run(2)
    assert core.leave(RADIO_A) == b""


def test_hello_twice_is_once_and_another_number_begins_anew(core: Core) -> None:
    core.open_session(5)
    core.tell(t.Data(0, 0, b"abc"), t.Hello(t.FINGERPRINT, 5), t.Data(0, 3, b"def"))
    core.run(2)
    assert core.leave(RADIO_A) == b"abcdef"
    core.open_session(6)
    core.tell(t.Data(0, 0, b"new"))
    core.run(2)
    assert core.leave(RADIO_A) == b"new"


def test_the_rate_changes_when_all_bytes_are_out(core: Core) -> None:
    core.open_session()
    core.tell(t.Data(0, 0, b"old rate"), t.SetBaud(1, 0, 9_600))
    core.run(20)
    assert core.baud(RADIO_A) == 115_200
    assert core.leave(RADIO_A) == b"old rate"
    core.run(1)
    assert core.baud(RADIO_A) == 9_600
    assert t.Done(1, t.Result.DONE) in core.heard()


@pytest.mark.parametrize("command", [t.SetBaud(3, 0, 230_400), t.SetBaud(3, 9, 9_600), t.ResetRadio(3, 0, 5_000)])
def test_commands_that_make_no_sense_are_refused(core: Core, command: t.SetBaud | t.ResetRadio) -> None:
    core.open_session()
    core.tell(command)
    core.run(2)
    assert of_kind(core.heard(), t.Done) == [t.Done(3, t.Result.BAD_VALUE)]


def test_a_repeated_command_is_carried_out_once_and_answered_again(core: Core) -> None:
    core.open_session()
    core.tell(t.ResetRadio(9, 1, 20))
    core.run(5)
    assert core.is_low(1)
    assert not core.is_low(0)
    core.tell(t.ResetRadio(9, 1, 20))
    core.run(20)
    assert not core.is_low(1)
    assert of_kind(core.heard(), t.Done) == [t.Done(9, 0)]
    core.tell(t.ResetRadio(9, 1, 20))
    core.run(1)
    assert not core.is_low(1)
    assert of_kind(core.heard(), t.Done) == [t.Done(9, 0)]


def test_a_new_session_lets_go_of_a_radio_in_reset(core: Core) -> None:
    core.open_session(5)
    core.tell(t.ResetRadio(1, 0, 1_000))
    assert core.is_low(0)
    core.open_session(6)
    assert not core.is_low(0)


@pytest.mark.parametrize("port", [USB, RADIO_A, RADIO_B])
def test_a_ring_that_stands_still_stops_the_firmware_with_its_name(core: Core, port: int) -> None:
    core.open_session()
    core.tell(t.Acknowledge(0, 0, 1_000), t.Data(0, 0, b"a"), t.Data(1, 0, b"b"))
    for _ in range(900):
        core.run(1)
        for other in {USB, RADIO_A, RADIO_B} - {port}:
            core.leave(other)
    assert core.stopped() == (t.ResetCause.RING_STUCK, 2 * port + 1)


def test_the_watchdog_is_fed_while_all_is_well_and_time_goes_on(core: Core) -> None:
    for _ in range(1_000):
        core.run(1)
        core.leave(USB)
    fed = core.fed()
    assert fed > 900
    core.run(0)
    core.run(0)
    assert core.fed() <= fed + 1


def test_damage_costs_the_frames_it_hit_and_no_more(core: Core, rng: np.random.Generator) -> None:
    core.open_session()
    sound = 0
    for _ in range(300):
        data = bytearray(encode(t.SetBaud(0, 9, 9_600)))  # refused and answered, each time
        if rng.random() < 0.5:
            data[rng.integers(len(data))] ^= 1 << rng.integers(8)
            data += b"\0"
        else:
            sound += 1
        core.arrive(USB, bytes(data))
        core.run(1)
        core.heard()
    core.tell(t.Ping(1))
    core.run(3)
    (own,) = of_kind(core.heard(), t.Health)
    assert own.frames_in >= sound + 2
    assert own.usb_bad_frames >= 100


def test_python_and_the_core_agree_which_frames_are_sound(core: Core, rng: np.random.Generator) -> None:
    core.open_session()
    reader = FrameReader()
    pings = 0
    for _ in range(400):
        data = bytearray(encode(t.Ping(0)))
        for _ in range(rng.integers(3)):
            data[rng.integers(len(data) - 1)] = rng.integers(256)
        pings += len([f for f in reader.feed(bytes(data)) if isinstance(f, t.Ping) and f.wants_health == 0])
        core.arrive(USB, bytes(data))
        core.run(1)
        core.heard()
    core.tell(t.Ping(1))
    core.run(3)
    (own,) = of_kind(core.heard(), t.Health)
    assert own.frames_in == pings + 2
    assert pings > 100
