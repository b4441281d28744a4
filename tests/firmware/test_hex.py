"""The unchanged hex on an emulated ATmega2560, in virtual time, against the host's session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared.protocol import transceiver as t
from shared.protocol.transceiver_frame import encode
from shared.protocol.transceiver_session import State
from tests.firmware.benches import Bench
from tools.simulator.devices.mega import MegaEvent, StepMega
from tools.simulator.devices.mega_build import MegaFiles

FULL_RATE = 23  # bytes in 2 ms at 115200
EACH_WAY = 10_000


def exchange(bench: Bench, rng: np.random.Generator, count: int, limit_s: float, per_step: int = FULL_RATE) -> None:
    """`count` bytes each way on both radios at once, all compared."""
    down = [rng.bytes(count) for _ in range(2)]
    up = [rng.bytes(count) for _ in range(2)]
    written, spoken, heard = [0, 0], 0, [bytearray(), bytearray()]
    before = [len(sent) for sent in bench.sent]
    until_s = bench.now_s + limit_s
    while any(len(h) < count for h in heard) or any(
        len(s) < count + b for s, b in zip(bench.sent, before, strict=True)
    ):
        assert bench.now_s < until_s, f"{[len(h) for h in heard]} up, {[len(s) for s in bench.sent]} down"
        for radio in range(2):
            written[radio] += bench.session.write(radio, down[radio][written[radio] :][:1_000])
        bench.step((up[0][spoken : spoken + per_step], up[1][spoken : spoken + per_step]))
        spoken += per_step
        for radio in range(2):
            heard[radio] += bench.session.read(radio)
    assert [bytes(h) for h in heard] == up
    assert [bytes(s[b:]) for s, b in zip(bench.sent, before, strict=True)] == down


def health_of(bench: Bench) -> t.Health:
    bench.run(1.2)
    board = bench.session.health.board
    assert board is not None
    return board


def spoiler(rng: np.random.Generator, one_in: int):
    """Flips a bit in one byte of so many."""

    def spoil(data: bytes) -> bytes:
        spoilt = np.frombuffer(data, np.uint8).copy()
        hit = rng.random(len(spoilt)) < 1 / one_in
        spoilt[hit] ^= (1 << rng.integers(0, 8, hit.sum())).astype(np.uint8)
        return spoilt.tobytes()

    return spoil


def test_all_bytes_arrive_both_ways_at_full_rate_and_no_ring_overflows(bench: Bench, rng: np.random.Generator) -> None:
    bench.bring_up()
    exchange(bench, rng, EACH_WAY, limit_s=2.0)
    board = health_of(bench)
    radios = [r for r in bench.session.health.radios if r is not None]
    assert [(r.bytes_in, r.bytes_out) for r in radios] == [(EACH_WAY, EACH_WAY)] * 2
    assert [(r.ring_full, r.overrun, r.framing, r.stream_full, r.resent_bytes) for r in radios] == [(0,) * 5] * 2
    assert (board.usb_ring_full, board.usb_overrun, board.usb_bad_frames) == (0, 0, 0)
    assert bench.session.health.resent_bytes == 0
    assert board.usb_in_high_water < 255
    assert board.free_ram_bytes > 1_000
    assert board.longest_loop_us < 5_000


def test_flow_control_holds_on_a_radio_port_a_dozen_times_slower_than_usb(
    bench: Bench, rng: np.random.Generator
) -> None:
    bench.bring_up()
    for radio in range(2):
        bench.session.set_baud(radio, 9_600)
    bench.run(0.1)
    exchange(bench, rng, 800, limit_s=4.0, per_step=1)
    board = health_of(bench)
    assert (board.usb_ring_full, bench.session.health.resent_bytes) == (0, 0)


def test_nothing_is_lost_or_doubled_while_usb_garbles_bytes_both_ways(bench: Bench, rng: np.random.Generator) -> None:
    bench.bring_up()
    bench.spoil, bench.spoil_back = spoiler(rng, 1_000), spoiler(rng, 1_000)
    exchange(bench, rng, 4_000, limit_s=10.0, per_step=2)
    bench.spoil = bench.spoil_back = bytes
    assert health_of(bench).usb_bad_frames > 5
    assert bench.session.health.bad_frames > 5
    assert bench.session.health.losses == 0


def test_garbage_before_and_between_frames_is_read_over(bench: Bench, rng: np.random.Generator) -> None:
    bench.mega.run(50_000, rng.bytes(2_000))
    bench.bring_up()
    for _ in range(20):
        out = bench.mega.run(2_000, rng.bytes(40) + b"\0")
        bench.now_s = out.now_us / 1e6
        bench.session.feed(out.usb, bench.now_s)
    exchange(bench, rng, 500, limit_s=2.0)
    assert bench.session.health.losses == 0


def test_a_host_that_vanishes_in_mid_frame_is_forgotten_and_the_next_one_served(
    bench: Bench, rng: np.random.Generator
) -> None:
    bench.bring_up()
    half = encode(t.Data(0, 0, b"never finished"))[:9]
    bench.mega.run(2_500_000, half)
    follower = Bench(bench.mega)
    follower.bring_up()
    follower.sent = [bytearray(), bytearray()]
    exchange(follower, rng, 1_000, limit_s=2.0)
    assert bytes(bench.sent[0]) == b""


def test_a_reset_in_the_middle_of_traffic_ends_the_session_and_a_new_one_begins(
    bench: Bench, rng: np.random.Generator
) -> None:
    bench.bring_up()
    bench.session.write(0, rng.bytes(3_000))
    bench.run(0.1)
    began = bench.session.generation
    bench.mega.reset()
    bench.until(lambda: bench.session.generation > began, limit_s=1.0)
    assert bench.session.health.reset_cause is t.ResetCause.RESET_PIN
    bench.bring_up()
    exchange(bench, rng, 1_000, limit_s=2.0)


def test_the_rates_of_the_radios_come_back_after_a_reset(bench: Bench) -> None:
    bench.bring_up()
    command = bench.session.set_baud(1, 38_400)
    bench.until(lambda: command.finished)
    bench.mega.reset()
    bench.until(lambda: not bench.session.is_up)
    bench.events.clear()
    bench.bring_up()
    assert MegaEvent("baud", (2, 38_461)) in bench.events


def test_the_watchdog_bites_when_the_main_loop_hangs_and_says_so(bench: Bench, rng: np.random.Generator) -> None:
    bench.bring_up()
    bench.mega.hang()
    bench.until(lambda: bench.session.generation == 1, limit_s=2.0)
    assert bench.session.health.reset_cause is t.ResetCause.HUNG
    assert "watchdog" in bench.session.trouble
    bench.bring_up()
    exchange(bench, rng, 1_000, limit_s=2.0)


@pytest.mark.parametrize("port", list(t.Port))
def test_a_port_that_stops_sending_restarts_the_firmware_with_its_name(bench: Bench, port: t.Port) -> None:
    bench.bring_up()
    bench.events.clear()
    bench.mega.mute(port)
    bench.session.write(max(0, port - 1), b"stuck")
    bench.until(lambda: bench.session.generation == 1, limit_s=3.0)
    bench.bring_up()
    assert MegaEvent("reset") in bench.events
    health = bench.session.health
    assert (health.reset_cause, health.reset_detail) == (t.ResetCause.RING_STUCK, 2 * port + 1)


def test_losing_the_power_is_told_from_a_reset(bench: Bench) -> None:
    bench.bring_up()
    bench.mega.power_cycle()
    bench.until(lambda: not bench.session.is_up)
    bench.bring_up()
    assert bench.session.health.reset_cause is t.ResetCause.POWER_ON


def test_the_radio_port_changes_its_rate(bench: Bench) -> None:
    bench.bring_up()
    command = bench.session.set_baud(0, 57_600)
    bench.until(lambda: command.finished)
    assert command.result is t.Result.DONE
    assert MegaEvent("baud", (1, 57_142)) in bench.events
    health_of(bench)
    radio = bench.session.health.radios[0]
    assert radio is not None
    assert radio.baud == 57_600


def test_what_was_written_before_a_change_of_rate_goes_out_before_it(bench: Bench, rng: np.random.Generator) -> None:
    bench.bring_up()
    data = rng.bytes(600)
    bench.session.write(0, data)
    command = bench.session.set_baud(0, 9_600)
    bench.until(lambda: command.finished)
    assert bytes(bench.sent[0]) == data


def test_a_radio_is_reset_for_as_long_as_asked(bench: Bench) -> None:
    bench.bring_up()
    command = bench.session.reset_radio(1, 100)
    bench.until(lambda: MegaEvent("resetb", (1, 0)) in bench.events)
    began_s = bench.now_s
    bench.until(lambda: command.finished)
    assert MegaEvent("resetb", (1, 1)) in bench.events
    assert bench.now_s - began_s == pytest.approx(0.1, abs=0.01)
    assert MegaEvent("resetb", (0, 0)) not in bench.events


def test_a_host_of_another_version_is_refused_with_a_word_of_what_to_do(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(t, "FINGERPRINT", t.FINGERPRINT ^ 0xFFFF)
    bench.until(lambda: bench.session.state is State.REFUSED)
    assert "make flash-transceiver" in bench.session.trouble


def test_the_same_bytes_give_the_same_answer(mega_files: MegaFiles) -> None:
    def run() -> list[bytes]:
        with StepMega(mega_files) as mega:
            bench = Bench(mega)
            bench.bring_up()
            bench.session.write(0, bytes(range(200)))
            bench.run(0.2)
            return [bytes(bench.sent[0]), str(bench.now_s).encode(), str(bench.usb_bytes).encode()]

    assert run() == run()


def test_the_boot_loader_lets_a_host_in_that_keeps_silent(
    mega_files: MegaFiles, boot_loader: Path, rng: np.random.Generator
) -> None:
    with StepMega(mega_files, boot_loader) as mega:
        bench = Bench(mega)
        bench.bring_up()
        bench.session.write(0, rng.bytes(3_000))
        bench.run(0.1)
        mega.reset()
        bench.until(lambda: not bench.session.is_up, limit_s=2.0)
        bench.until(lambda: bench.session.is_up, limit_s=15.0)
        exchange(bench, rng, 500, limit_s=2.0)
