"""The emulated module at its wire: every answer byte for byte, its radio, its faults."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from shared.link.es920lr.airtime import Modulation, ack_airtime_s, airtime_s, carrier_sense_s, packets_per_s
from shared.link.es920lr.settings import (
    BAUD_RATES,
    ROWS,
    BootMode,
    Format,
    Node,
    RadioSettings,
    Sleep,
    Transfer,
)
from tests.shared.link.radio_rig import LINK, ROBOT, STATION, Rig, exchange, listen, operating
from tools.simulator.devices.es920lr import EmulatedEs920lr, State
from tools.simulator.radio.ports import EmulatedPort

QUESTION = b"\r\nSelect Mode [1.terminal or 2.processor]\r\n"
SHOWN = """
  configuration setting is below.
  -------------------------------------
  Node                        : EndDevice
  Band Width                  : 125kHz
  Spreading Factor            : 7
  Effective Bitrate           : 5469bps
  Channel                     : 1
  PAN ID                      : 0001
  Own Node ID                 : 0001
  Destination ID              : 0000
  Acknowledge                 : ON
  Retry count                 : 3
  Transfer Mode               : Payload
  Receive Node ID information : OFF
  RSSI information            : OFF
  Config/Operation            : Configuration
  UART baudrate               : 115200
  Sleep Mode                  : No Sleep
  Sleep Time                  : 50
  Output Power                : 13dBm
  Format                      : ASCII
  Send Time                   : 0
  Send Data                   : 

""".replace("\n", "\r\n")  # noqa: W291
FRAME = bytes((50,)) + bytes(range(50))


def booted(flash: RadioSettings | None = None) -> tuple[Rig, EmulatedEs920lr, EmulatedPort]:
    rig = Rig()
    module = rig.module("module", flash)
    return rig, module, rig.port(module)


def configured(flash: RadioSettings | None = None) -> tuple[Rig, EmulatedEs920lr, EmulatedPort]:
    rig, module, port = booted(flash)
    listen(port, 0.1)
    assert exchange(port, b"processor\r\n") == b"OK\r\n"
    return rig, module, port


class Pair:
    def __init__(self, first: RadioSettings = ROBOT, second: RadioSettings = STATION) -> None:
        self.rig = Rig()
        self.first, self.second = (
            self.rig.module(name, operating(s), (x_m, 0.0))
            for name, s, x_m in (("first", first, 0.0), ("second", second, 10.0))
        )
        self.ports = self.rig.port(self.first), self.rig.port(self.second)
        self.rig.run(0.1)
        for port in self.ports:
            assert port.read(0.0).startswith(b"\xfc\xfc\r\n")


@pytest.mark.parametrize("baud_rate", BAUD_RATES)
def test_it_asks_for_the_mode_after_a_little_noise(baud_rate: int) -> None:
    _, _, port = booted(RadioSettings(baud_rate=baud_rate))
    said = listen(port, 0.2)
    assert said.endswith(QUESTION)
    assert set(said[: -len(QUESTION)]) <= {0xFC, 0xFF, 0xE0}


@pytest.mark.parametrize("word", [b"1", b"2", b"terminal", b"processor"])
def test_it_takes_the_mode_as_word_or_number(word: bytes) -> None:
    _, _, port = booted()
    listen(port, 0.1)
    assert exchange(port, word + b"\r\n").startswith(b"OK\r\n")


def test_other_words_are_no_mode() -> None:
    _, _, port = booted()
    listen(port, 0.1)
    for word in (b"", b"3", b"Processor", b"processor "):
        assert exchange(port, word + b"\r\n") == b"NG 002\r\n"


def test_a_person_gets_a_prompt() -> None:
    _, module, port = booted()
    listen(port, 0.1)
    assert exchange(port, b"terminal\r\n").endswith(b"LORA > ")
    assert exchange(port, b"\r\n").endswith(b"LORA > ")
    assert exchange(port, b"sf\r\n").endswith(b"> ")
    assert exchange(port, b"9\r\n").endswith(b"LORA > ")
    assert module.settings.spreading_factor == 9
    assert b"operation mode is ready" in exchange(port, b"start\r\n")


def test_it_shows_its_settings_as_the_firmware_prints_them() -> None:
    _, _, port = configured()
    assert exchange(port, b"show\r\n").decode() == SHOWN
    assert exchange(port, b"y\r\n").decode() == SHOWN
    assert exchange(port, b"version\r\n") == b"VER 1.12\r\n"


@pytest.mark.parametrize(
    "line",
    [
        *(b"node 1", b"a 2", b"bw 3", b"bw 6", b"b 5", b"sf 7", b"sf 12", b"channel 15", b"panid FFFE", b"e 0001"),
        *(b"ownid 0000", b"dstid FFFF", b"dstid 7", b"ack 2", b"retry 0", b"retry 10", b"transmode 2", b"rcvid 1"),
        *(b"rssi 1", b"operation 2", b"sleep 3", b"sleeptime 864000", b"power -4", b"power 13", b"format 2"),
        *(b"sendtime 86400", b"senddata hello", b"C hello", b"save", b"load"),
    ],
)
def test_it_takes_what_the_table_of_commands_has(line: bytes) -> None:
    _, _, port = configured()
    assert exchange(port, line + b"\r\n") == b"OK\r\n"


@pytest.mark.parametrize(
    "line",
    [
        *(b"node 3", b"bw 2", b"bw 7", b"sf 6", b"sf 13", b"channel 0", b"channel 16", b"panid 0000", b"panid FFFF"),
        *(b"ownid FFFF", b"dstid 10000", b"dstid xyz", b"ack 0", b"retry 11", b"sleep 4", b"sleeptime 0"),
        *(b"power -5", b"power 14", b"format 3", b"sendtime 86401", b"baudrate 0", b"baudrate 7", b"sf", b"bw x"),
    ],
)
def test_values_out_of_range_are_refused(line: bytes) -> None:
    _, module, port = configured()
    assert exchange(port, line + b"\r\n") == b"NG 002\r\n"
    assert module.settings == RadioSettings()


@pytest.mark.parametrize("line", [b"", b"hello", b"hopcount 1", b"route1 0001", b"SF 7", b"start 1"])
def test_commands_of_other_builds_are_unknown(line: bytes) -> None:
    assert exchange(configured()[2], line + b"\r\n") == b"NG 001\r\n"


def test_a_new_bandwidth_moves_a_channel_that_it_does_not_have() -> None:
    _, module, port = configured()
    exchange(port, b"channel 9\r\n")
    exchange(port, b"bw 6\r\n")
    assert (module.settings.bandwidth_hz, module.settings.channel) == (500_000, 1)


@pytest.mark.parametrize("baud_rate", BAUD_RATES)
def test_it_changes_its_rate_right_after_the_ok(baud_rate: int) -> None:
    _, _, port = configured()
    assert exchange(port, b"baudrate %d\r\n" % (BAUD_RATES.index(baud_rate) + 1)) == b"OK\r\n"
    port.set_baud_rate(baud_rate)
    assert exchange(port, b"version\r\n") == b"VER 1.12\r\n"


def test_at_another_rate_it_hears_and_says_garbage() -> None:
    _, _, port = configured()
    port.set_baud_rate(9_600)
    assert exchange(port, b"version\r\n") == b""
    port.set_baud_rate(115_200)
    assert b"VER" not in exchange(port, b"version\r\n")
    assert exchange(port, b"version\r\n") == b"VER 1.12\r\n"


def test_only_what_was_saved_outlives_a_power_cut() -> None:
    _, module, port = configured()
    exchange(port, b"sf 9\r\n")
    exchange(port, b"save\r\n")
    exchange(port, b"sf 10\r\n")
    module.power_off()
    assert listen(port, 0.2) == b""
    module.power_on()
    assert listen(port, 0.2).endswith(QUESTION)
    assert module.settings.spreading_factor == 9


@pytest.mark.parametrize("refusal", [3, 4])
def test_flash_memory_may_fail(refusal: int) -> None:
    _, module, port = configured()
    module.flash_refusal = refusal
    assert exchange(port, b"save\r\n") == b"NG %03d\r\n" % refusal
    assert module.flash_writes == 0


def test_the_factory_settings_come_back_at_the_factory_rate() -> None:
    _, module, port = configured(RadioSettings(baud_rate=9_600, spreading_factor=12))
    assert exchange(port, b"load\r\n") == b"OK\r\n"
    port.set_baud_rate(115_200)
    assert exchange(port, b"version\r\n") == b"VER 1.12\r\n"
    assert module.settings == RadioSettings()


def test_it_starts_with_an_empty_line_and_says_no_more() -> None:
    _, module, port = configured()
    assert exchange(port, b"start\r\n") == b"OK\r\n\r\n"
    assert module.state is State.OPERATION
    assert exchange(port, b"show\r\n", 0.0) == b""


def test_a_pin_held_low_brings_it_into_configuration() -> None:
    _, module, port = booted(operating(ROBOT))
    assert listen(port, 0.1).endswith(b"\xfc\r\n")
    module.configuration_pin = True
    module.reset()
    assert listen(port, 0.1).endswith(QUESTION)


@pytest.mark.parametrize("format_", Format)
def test_the_word_config_is_silent_and_counts_from_the_next_reset(format_: Format) -> None:
    _, module, port = booted(operating(dataclasses.replace(ROBOT, format=format_)))
    listen(port, 0.1)
    assert exchange(port, b"config\r\n", 1.0) == b""
    assert module.flash.boot_mode is BootMode.CONFIGURATION
    assert module.state is State.OPERATION
    module.reset()
    assert listen(port, 0.1).endswith(QUESTION)


def test_in_binary_the_word_needs_a_zero_behind_it() -> None:
    """A frame sent before has left its bytes in the buffer."""
    _, module, port = booted(operating(ROBOT))
    listen(port, 0.1)
    exchange(port, b"\x08\xff\xff\xff\xff\xff\xff\xff\xff", 1.0)
    exchange(port, b"config", 1.0)
    assert module.flash_writes == 0
    exchange(port, bytes(8), 1.0)
    exchange(port, b"config", 1.0)
    assert module.flash_writes == 1


def test_half_a_frame_is_forgotten_after_half_a_second() -> None:
    rig, module, port = booted(operating(ROBOT))
    listen(port, 0.1)
    port.write(b"\x0512")
    rig.run(0.4)
    port.write(b"345")
    assert listen(port, 0.3) == b"\x02OK"
    port.write(b"\x0512")
    rig.run(0.6)
    assert exchange(port, b"345", 0.6) == b""
    assert exchange(port, b"\x01x") == b"\x02OK"
    assert module.mac.statistics.packets == 2


@pytest.mark.parametrize(
    ("format_", "said", "answer"),
    [
        (Format.BINARY, b"\x01x", b"\x02OK"),
        (Format.ASCII, b"x\r\n", b"OK\r\n"),
        (Format.BINARY, bytes((51,)) + bytes(51), b"\x06NG 100"),
        (Format.ASCII, b"x" * 51 + b"\r\n", b"NG 100\r\n"),
        (Format.ASCII, b"\r\n", b""),
        (Format.ASCII, b"\x00binary\r\n", b""),
    ],
)
def test_it_answers_in_its_format(format_: Format, said: bytes, answer: bytes) -> None:
    _, _, port = booted(operating(dataclasses.replace(ROBOT, format=format_)))
    listen(port, 0.1)
    assert exchange(port, said) == answer


def test_while_it_sends_it_takes_nothing_else() -> None:
    pair = Pair()
    pair.ports[0].write(FRAME)
    pair.rig.run(0.03)
    assert exchange(pair.ports[0], b"\x01x", 0.02) == b"\x06NG 101"
    assert listen(pair.ports[0], 0.1) == b"\x02OK"
    assert pair.first.mac.statistics.packets == 1


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, b"\x0f" + b"FFD2" + b"00010001" + b"abc"),
        ({"show_sender": False}, b"\x07" + b"FFD2" + b"abc"),
        ({"show_rssi": False}, b"\x0b" + b"00010001" + b"abc"),
        ({"show_rssi": False, "show_sender": False}, b"\x03abc"),
        ({"format": Format.ASCII}, b"FFD200010001abc\r\n"),
    ],
)
def test_a_packet_is_delivered_as_it_is_asked_for(changes: dict[str, object], expected: bytes) -> None:
    pair = Pair(ROBOT, dataclasses.replace(STATION, **changes))  # type: ignore[arg-type]
    pair.ports[0].write(b"\x03abc")
    assert listen(pair.ports[1], 0.3) == expected


def test_it_hears_its_network_and_its_address_and_what_is_for_all() -> None:
    for changes, hears in (
        ({"pan_id": 2}, False),
        ({"own_id": 3}, False),
        ({"channel": 2}, False),
        ({"spreading_factor": 8}, False),
        ({}, True),
    ):
        pair = Pair(ROBOT, dataclasses.replace(STATION, **changes))  # type: ignore[arg-type]
        pair.ports[0].write(b"\x03abc")
        assert (listen(pair.ports[1], 0.3) != b"") is hears
    pair = Pair(dataclasses.replace(ROBOT, destination_id=0xFFFF), dataclasses.replace(STATION, own_id=3))
    pair.ports[0].write(b"\x03abc")
    assert listen(pair.ports[1], 0.3).endswith(b"abc")


def test_in_frame_mode_each_packet_has_its_address() -> None:
    pair = Pair(dataclasses.replace(ROBOT, transfer=Transfer.FRAME, destination_id=0x0BAD))
    pair.ports[0].write(b"\x0b" + b"00010002" + b"abc")
    assert listen(pair.ports[1], 0.3).endswith(b"00010001abc")
    assert pair.ports[0].read(0.0) == b"\x02OK"
    assert exchange(pair.ports[0], b"\x08" + b"00010002") == b"\x06NG 100"


@pytest.mark.parametrize("spreading_factor", range(7, 13))
@pytest.mark.parametrize("bandwidth_hz", [62_500, 125_000, 250_000, 500_000])
def test_back_to_back_packets_are_as_many_as_the_table_says(bandwidth_hz: int, spreading_factor: int) -> None:
    """Airtime and pause alone, as the table leaves out carrier sense; and with it, as the module really does."""
    modulation = Modulation(bandwidth_hz, spreading_factor)
    settings = dataclasses.replace(ROBOT, bandwidth_hz=bandwidth_hz, spreading_factor=spreading_factor)
    for carrier_sense, sense_s in ((False, 0.0), (True, carrier_sense_s(bandwidth_hz))):
        rig = Rig()
        module = rig.module("module", operating(settings))
        rig.run(0.1)
        module.mac.carrier_sense = carrier_sense
        ends_s: list[float] = []
        module.mac._done = lambda refusal: (  # type: ignore[method-assign, assignment]
            ends_s.append(rig.timeline.now_s),  # noqa: B023
            module.mac.send(bytes(50), 1, 2),  # noqa: B023
        )
        module.mac.send(bytes(50), 1, 2)
        rig.run(9.5 * (airtime_s(modulation, 50) + 0.050 + sense_s))
        rate = (len(ends_s) - 1) / (ends_s[-1] - ends_s[0])
        assert rate == pytest.approx(1 / (1 / packets_per_s(modulation, 50) + sense_s), rel=1e-9)


def test_a_busy_channel_is_listened_to_three_times() -> None:
    pair = Pair()
    jammer = pair.rig.module("jammer", operating(dataclasses.replace(LINK, own_id=9, spreading_factor=12)))
    pair.rig.run(0.1)
    jammer.mac.send(bytes(50), 1, 9)
    pair.rig.run(0.1)
    began_s = pair.rig.clock.now_s()
    pair.ports[0].write(b"\x01x")
    assert pair.ports[0].read(1.0)[:1] == b"\x06"
    took_s = pair.rig.clock.now_s() - began_s
    assert took_s == pytest.approx(3 * 0.004 + 3 * 10 / 115_200, abs=2e-4)


def test_a_channel_that_becomes_free_in_time_is_used() -> None:
    pair = Pair()
    pair.second.mac.send(b"x", 1, 9)
    pair.rig.run(0.008 + airtime_s(ROBOT.modulation, 1) - 0.002)
    assert exchange(pair.ports[0], b"\x01x") == b"\x02OK"


ACK = dataclasses.replace(LINK, acknowledge=True, retries=2)
FIRST, SECOND = (dataclasses.replace(ACK, own_id=a, destination_id=b) for a, b in ((1, 2), (2, 1)))


def test_an_acknowledged_packet_is_delivered_once_and_told_after_the_pause() -> None:
    pair = Pair(FIRST, SECOND)
    began_s = pair.rig.clock.now_s()
    pair.first.mac.send(bytes(50), 1, 2)
    assert listen(pair.ports[1], 0.3).count(b"FFD200010001") == 1
    assert pair.ports[0].read(0.0) == b"\x02OK"
    assert pair.second.mac.statistics.acknowledgements == 1
    assert ack_airtime_s(ACK.modulation) + carrier_sense_s(500_000) < 0.050 < pair.rig.clock.now_s() - began_s


def lose_acknowledgements(pair: Pair, count: int) -> None:
    """The next acknowledgements are not heard."""
    heard = pair.first.antenna.heard

    def deaf(frame: object, power_dbm: float) -> None:
        nonlocal count
        if getattr(frame, "is_ack", False) and count > 0:
            count -= 1
        else:
            heard(frame, power_dbm)  # type: ignore[arg-type]

    pair.first.antenna.heard = deaf


def test_a_packet_whose_acknowledgement_is_lost_is_delivered_twice() -> None:
    pair = Pair(FIRST, SECOND)
    lose_acknowledgements(pair, 1)
    pair.ports[0].write(b"\x04once")
    assert listen(pair.ports[1], 1.0).count(b"once") == 2
    assert pair.ports[0].read(0.0) == b"\x02OK"


def test_a_packet_that_is_never_acknowledged_is_given_up() -> None:
    pair = Pair(FIRST, SECOND)
    lose_acknowledgements(pair, 9)
    pair.ports[0].write(b"\x04once")
    assert listen(pair.ports[1], 2.0).count(b"once") == 3
    assert pair.ports[0].read(0.0) == b"\x06NG 103"


def test_what_comes_while_a_send_is_pending_is_acknowledged_and_thrown_away() -> None:
    pair = Pair(FIRST, SECOND)
    third = pair.rig.module("third", operating(dataclasses.replace(ACK, own_id=3, destination_id=1)), (5.0, 0.0))
    third_port = pair.rig.port(third)
    pair.rig.run(0.1)
    third_port.read(0.0)
    pair.second.power_off()  # so that the first waits for an acknowledgement in vain
    pair.ports[0].write(b"\x01x")
    pair.rig.run(0.028)
    assert exchange(third_port, b"\x01y", 0.5) == b"\x02OK"
    pair.rig.run(2.0)
    assert b"y" not in pair.ports[0].read(0.0)
    assert pair.first.mac.statistics.dropped_while_sending == 1


def test_a_packet_whose_acknowledgement_finds_the_channel_busy_is_lost() -> None:
    pair = Pair(FIRST, SECOND)
    jammer = pair.rig.module("jammer", operating(dataclasses.replace(LINK, own_id=9, spreading_factor=12)))
    pair.rig.run(0.1)
    pair.ports[0].write(b"\x01x")
    pair.rig.run(0.02)
    jammer.mac.carrier_sense = False
    jammer.mac.send(bytes(50), 1, 9)
    assert listen(pair.ports[1], 0.5) == b""
    assert pair.second.mac.statistics.lost_without_acknowledgement >= 1


def test_after_a_packet_it_is_deaf_until_its_ok() -> None:
    pair = Pair()
    pair.ports[0].write(b"\x01x")
    pair.rig.run(0.008 + airtime_s(ROBOT.modulation, 1) + 0.002)  # the first is in its pause now
    pair.ports[1].write(b"\x01y")
    assert b"y" not in listen(pair.ports[0], 0.5)
    pair.ports[1].write(b"\x01z")
    assert listen(pair.ports[0], 0.5).endswith(b"z")


def test_a_power_cut_in_the_middle_of_a_packet_ends_it() -> None:
    pair = Pair()
    pair.ports[0].write(FRAME)
    pair.rig.run(0.03)
    pair.first.power_off()
    assert listen(pair.ports[1], 0.5) == b""
    assert listen(pair.ports[0], 0.5) == b""
    pair.first.power_on()
    assert listen(pair.ports[0], 0.2).endswith(b"\xfc\r\n")


def test_a_flood_of_bytes_while_it_listens_overruns_64_of_them() -> None:
    pair = Pair()
    pair.ports[0].write(b"\x01x" + bytes(150))
    pair.rig.run(1.0)
    assert pair.first.line.overrun_bytes == pytest.approx(0.008 * 11_520 - 64, abs=2)


def test_timer_sleep_hears_nothing_until_it_wakes_and_sends() -> None:
    sleepy = dataclasses.replace(STATION, sleep=Sleep.TIMER, sleep_time_s=2.0)
    rig = Rig()
    sleeper, waker = rig.module("sleeper", operating(sleepy)), rig.module("waker", operating(ROBOT), (10.0, 0.0))
    ports = rig.port(sleeper), rig.port(waker)
    rig.run(0.5)
    assert sleeper.state is State.ASLEEP
    ports[1].write(b"\x01x")
    assert b"x" not in listen(ports[0], 0.5)
    rig.run(1.5)
    assert sleeper.state is State.OPERATION
    ports[1].write(b"\x01y")
    assert listen(ports[0], 0.3).endswith(b"y")
    assert exchange(ports[0], b"\x01z") == b"\x02OK"
    assert sleeper.state is State.ASLEEP


def test_interrupt_sleep_ends_at_the_pin() -> None:
    sleepy = dataclasses.replace(STATION, sleep=Sleep.INTERRUPT)
    _, module, port = booted(operating(sleepy))
    listen(port, 0.1)
    assert exchange(port, b"\x01x") == b""
    module.wake_pin()
    assert exchange(port, b"\x01x") == b"\x02OK"
    module.wake_pin()
    assert module.state is State.ASLEEP


def test_a_coordinator_does_not_sleep() -> None:
    _, module, port = booted(operating(dataclasses.replace(STATION, sleep=Sleep.TIMER, node=Node.COORDINATOR)))
    listen(port, 0.1)
    assert module.state is State.OPERATION


def test_it_sends_by_itself_when_told_to() -> None:
    pair = Pair(dataclasses.replace(ROBOT, auto_send_interval_s=2, auto_send_text="beep"))
    assert listen(pair.ports[1], 7.0).count(b"beep") in {3, 4}


def test_a_port_that_nobody_reads_has_a_bound() -> None:
    pair = Pair(dataclasses.replace(ROBOT, auto_send_interval_s=1, auto_send_text="x" * 50))
    pair.rig.run(1_500.0)
    assert len(pair.second.line._to_host) <= 65_536


@pytest.mark.parametrize(
    "flash", [RadioSettings(), operating(ROBOT), operating(dataclasses.replace(ROBOT, format=Format.ASCII))]
)
def test_no_bytes_bring_it_down(flash: RadioSettings, rng: np.random.Generator) -> None:
    """Random bytes, and random values to every command, at any rate; a reset brings it back to its question."""
    rig, module, port = booted(flash)
    names = [
        *(row.command for row in ROWS),
        *(row.short for row in ROWS),
        "save",
        "load",
        "show",
        "start",
        "help",
        "1",
        "2",
    ]
    for _ in range(600):
        value = rng.bytes(int(rng.integers(8))) if rng.random() < 0.5 else b"%d" % rng.integers(-20, 20)
        port.set_baud_rate(module.line.baud_rate if rng.random() < 0.9 else 9_600)
        port.write(names[rng.integers(len(names))].encode() + b" " * int(rng.integers(2)) + value + b"\r\n")
        port.write(rng.bytes(int(rng.integers(100))))
        rig.run(float(rng.choice((0.01, 0.6))))
        port.read(0.0)
        if rng.random() < 0.02:
            module.reset()
    module.configuration_pin = True
    module.reset()
    port.set_baud_rate(module.flash.baud_rate)
    assert listen(port, 0.5).endswith(QUESTION)
