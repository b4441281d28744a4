"""The driver on emulated modules: bringing up, sending, hearing, faults of the module and of the line."""

from __future__ import annotations

import dataclasses
import math
import os

import numpy as np
import pytest

from shared.link.base import LinkError
from shared.link.es920lr.band import LONG_CARRIER_SENSE, SHORT_CARRIER_SENSE, BandError
from shared.link.es920lr.core import (
    Es920lrCore,
    Event,
    Failure,
    Lost,
    Ready,
    SendFailed,
    Sent,
)
from shared.link.es920lr.dialogue import Ask
from shared.link.es920lr.driver import Es920lr
from shared.link.es920lr.parser import MODE_QUESTION, Heard
from shared.link.es920lr.settings import (
    BAUD_RATES,
    BootMode,
    Format,
    RadioSettings,
    SettingsError,
    Sleep,
    Transfer,
)
from tests.shared.link.radio_rig import ROBOT, STATION, Rig, listen, operating
from tools.simulator.devices.es920lr import State
from tools.simulator.devices.es920lr_console import Console
from tools.simulator.radio.loss import Independent

FUZZED_BYTES = int(os.environ.get("FUZZED_BYTES", "2000000"))


class Pair:
    """Robot and station, both operating."""

    def __init__(self, robot: RadioSettings = ROBOT, station: RadioSettings = STATION) -> None:
        self.rig = Rig()
        self.modules = self.rig.module("robot"), self.rig.module("station", position_m=(10.0, 0.0))
        self.robot = self.rig.driver(self.modules[0], robot)
        self.station = self.rig.driver(self.modules[1], station)
        for driver in (self.robot, self.station):
            driver.wait_until_operating(5.0)

    def fate(self, driver: Es920lr, handle: int | None, timeout_s: float = 10.0) -> Event:
        """What became of a packet."""
        until_s = self.rig.clock.now_s() + timeout_s
        while self.rig.clock.now_s() < until_s:
            for event in driver.poll(timeout_s):
                if isinstance(event, Sent | SendFailed) and event.handle == handle:
                    return event
        raise AssertionError("the driver has not told")


@pytest.fixture
def pair() -> Pair:
    return Pair()


def heard(events: list[Event]) -> list[bytes]:
    return [event.payload for event in events if isinstance(event, Heard)]


def polled(driver: Es920lr, times: int) -> list[bytes]:
    """What has come in meanwhile."""
    return [payload for _ in range(times) for payload in heard(driver.poll(0.0))]


def test_a_module_as_it_comes_from_the_factory_is_configured_and_started() -> None:
    rig = Rig()
    module = rig.module("robot")
    driver = rig.driver(module, ROBOT)
    events = driver.wait_until_operating(5.0)
    assert events == [Ready(ROBOT)]
    assert module.settings == ROBOT
    assert module.state is State.OPERATION
    assert module.flash == RadioSettings()  # nothing was written


@pytest.mark.parametrize("baud_rate", BAUD_RATES)
def test_a_module_at_another_baud_rate_is_found_and_brought_to_ours(baud_rate: int) -> None:
    rig = Rig()
    module = rig.module("robot", RadioSettings(baud_rate=baud_rate))
    driver = rig.driver(module, ROBOT)
    driver.wait_until_operating(20.0)
    assert module.settings == ROBOT


@pytest.mark.parametrize("baud_rate", BAUD_RATES)
def test_a_module_that_operates_already_goes_on(baud_rate: int) -> None:
    rig = Rig()
    module = rig.module("robot", operating(dataclasses.replace(ROBOT, baud_rate=baud_rate)))
    rig.run(0.1)
    driver = rig.driver(module, ROBOT)
    assert driver.wait_until_operating(20.0) == [Ready(None)]
    assert rig.channel.statistics.packets == 0  # and was not made to send anything
    handle = driver.submit(b"hello")
    rig.run(0.8)
    assert driver.poll(0.0) == [Sent(handle)]


@pytest.mark.parametrize("baud_rate", [115_200, 38_400])
@pytest.mark.parametrize("with_reset", [True, False])
def test_a_module_left_operating_with_other_settings_is_set_anew_where_it_can_be_reset(
    with_reset: bool, baud_rate: int
) -> None:
    """An earlier program has configured and started it, and its settings have been changed since."""
    rig = Rig()
    module = rig.module("robot")
    earlier = dataclasses.replace(ROBOT, spreading_factor=9, baud_rate=baud_rate)
    rig.driver(module, earlier).wait_until_operating(5.0)
    events = rig.driver(module, ROBOT, with_reset).wait_until_operating(20.0)
    assert events == [Ready(ROBOT if with_reset else None)]
    assert module.settings == (ROBOT if with_reset else earlier)
    assert module.flash_writes == 0


def test_a_module_saved_for_operation_goes_on_after_its_reset() -> None:
    rig = Rig()
    module = rig.module("robot", operating(ROBOT))
    rig.run(0.1)
    assert rig.driver(module, ROBOT, with_reset=True).wait_until_operating(5.0) == [Ready(None)]
    assert (module.state, module.flash_writes) == (State.OPERATION, 0)


def test_a_module_in_the_wrong_format_needs_its_reset_pin() -> None:
    rig = Rig()
    flash = operating(dataclasses.replace(ROBOT, format=Format.ASCII))
    with_pin, without = rig.module("with", flash), rig.module("without", flash)
    rig.run(0.1)
    rig.driver(with_pin, ROBOT, with_reset=True).wait_until_operating(20.0)
    assert with_pin.settings == ROBOT
    driver = rig.driver(without, ROBOT)
    events = driver.poll(20.0)
    assert isinstance(events[0], Lost)
    assert "power off and on" in events[0].reason
    without.power_off()
    without.power_on()  # as it says
    driver.wait_until_operating(20.0)
    assert without.settings == ROBOT
    assert rig.channel.statistics.packets == 0


def test_a_module_that_a_person_was_configuring_is_taken_over_by_reset() -> None:
    rig = Rig()
    module = rig.module("robot")
    port = rig.port(module)
    rig.run(0.1)
    port.write(b"terminal\r\n")
    rig.run(0.5)
    rig.driver(module, ROBOT, with_reset=True).wait_until_operating(20.0)
    assert module.settings == ROBOT


def test_a_packet_goes_out_and_comes_in(pair: Pair) -> None:
    handle = pair.robot.submit(bytes(range(50)))
    assert pair.robot.busy
    assert pair.fate(pair.robot, handle) == Sent(handle)
    assert not pair.robot.busy
    event = pair.station.poll(0.0)[0]
    assert isinstance(event, Heard)
    assert (event.payload, event.pan_id, event.sender_id) == (bytes(range(50)), 1, 1)
    assert event.rssi_dbm == math.floor(pair.rig.channel.propagation.mean_dbm(13.0, 10.0))


def test_the_second_packet_waits_and_the_third_has_no_room(pair: Pair) -> None:
    first, second = pair.robot.submit(b"first"), pair.robot.submit(b"second")
    assert pair.robot.submit(b"third") is None
    assert not pair.robot.can_submit
    assert pair.fate(pair.robot, first) == Sent(first or 0)
    assert pair.robot.can_submit
    assert pair.fate(pair.robot, second) == Sent(second or 0)
    assert heard(pair.station.poll(0.0) + pair.station.poll(0.0)) == [b"first", b"second"]


def test_packets_handed_over_ahead_of_time_cost_no_serial_line() -> None:
    """Airtime, pause and carrier sense are 96.5 ms; 55 bytes at 115200 baud would be 4.8 ms more."""
    pair = Pair()
    began_s, sent = pair.rig.clock.now_s(), 0
    while sent < 50:
        while pair.robot.can_submit:
            pair.robot.submit(bytes(50))
        sent += sum(isinstance(event, Sent) for event in pair.robot.poll(1.0))
        pair.station.poll(0.0)
    period_s = (pair.rig.clock.now_s() - began_s) / 50
    assert period_s == pytest.approx(0.0385 + 0.050 + 0.008, abs=0.0008)
    assert pair.station.statistics.heard == 50


@pytest.mark.parametrize("spreading_factor", [9, 11])
def test_slow_packets_are_handed_over_when_the_module_is_about_to_be_ready(spreading_factor: int) -> None:
    pair = Pair(*(dataclasses.replace(s, spreading_factor=spreading_factor) for s in (ROBOT, STATION)))
    payloads = [bytes((i,)) * 50 for i in range(6)]
    waiting, arrived = list(payloads), []
    for _ in range(200):
        if waiting and pair.robot.can_submit:
            pair.robot.submit(waiting.pop(0))
        pair.robot.poll(0.05)
        arrived += heard(pair.station.poll(0.0))
    assert arrived == payloads
    assert pair.robot.statistics.failed == 0


def test_a_half_frame_that_the_module_may_have_forgotten_is_sent_again_whole(pair: Pair) -> None:
    """The computer was busy elsewhere when the OK came."""
    pair.robot.submit(b"one" * 10)
    pair.robot.poll(0.01)
    pair.robot.submit(b"two" * 10)
    pair.robot.poll(0.01)
    pair.rig.run(3.0)
    pair.robot.poll(0.0)
    pair.rig.run(1.0)
    for _ in range(20):
        pair.robot.poll(0.1)
    assert polled(pair.station, 9) == [b"one" * 10, b"two" * 10]
    assert pair.modules[0].line.overrun_bytes == 0


@pytest.mark.parametrize("payload", [b"", bytes(51)])
def test_a_payload_that_fits_no_packet_is_refused(pair: Pair, payload: bytes) -> None:
    with pytest.raises(ValueError, match="1 to 50"):
        pair.robot.submit(payload)


def test_a_busy_channel_is_told(pair: Pair) -> None:
    jammer = pair.rig.module("jammer", operating(dataclasses.replace(ROBOT, own_id=9, spreading_factor=12)))
    jam = pair.rig.port(jammer)
    pair.rig.run(0.1)
    jam.write(bytes((50,)) + bytes(50))
    pair.rig.run(0.1)
    handle = pair.robot.submit(b"into the noise")
    assert pair.fate(pair.robot, handle) == SendFailed(handle or 0, Failure.CHANNEL_BUSY)


def test_a_stuck_transmitter_is_told(pair: Pair) -> None:
    pair.modules[0].mac.is_stuck = True
    handle = pair.robot.submit(b"x")
    assert pair.fate(pair.robot, handle) == SendFailed(handle or 0, Failure.TRANSMITTER)


def test_a_missing_acknowledgement_is_told_after_all_retries() -> None:
    pair = Pair(*(dataclasses.replace(s, acknowledge=True, retries=2) for s in (ROBOT, STATION)))
    pair.modules[1].power_off()
    handle = pair.robot.submit(b"anybody there?")
    assert pair.fate(pair.robot, handle) == SendFailed(handle or 0, Failure.NO_ACKNOWLEDGEMENT)
    assert pair.modules[0].mac.statistics.packets == 3


def test_a_module_busy_with_an_earlier_program_is_asked_again(pair: Pair) -> None:
    pair.modules[0].mac.send(bytes(50), 1, 2)  # as a program that has ended left it
    handle = pair.robot.submit(b"now ours")
    assert pair.fate(pair.robot, handle) == SendFailed(handle or 0, Failure.BUSY)
    handle = pair.robot.submit(b"again")
    assert pair.fate(pair.robot, handle) == Sent(handle or 0)


@pytest.mark.parametrize("saved", [True, False])
def test_after_a_power_cut_the_module_is_brought_up_and_the_link_goes_on(saved: bool) -> None:
    rig = Rig()
    module, peer = rig.module("robot", operating(ROBOT) if saved else None), rig.module("peer", operating(STATION))
    driver, station = rig.driver(module, ROBOT), rig.driver(peer, STATION)
    for d in (driver, station):
        d.wait_until_operating(5.0)
    handle = driver.submit(bytes(50))
    rig.run(0.02)
    module.power_off()
    rig.run(0.005)
    module.power_on()
    events = driver.poll(1.0)
    while not driver.operating:
        events += driver.poll(1.0)
    assert SendFailed(handle or 0, Failure.RESTARTED) in events
    assert next(type(e) for e in events if isinstance(e, Lost | Ready)) is Lost
    assert isinstance(events[-1], Ready)
    rig.run(1.0)
    driver.poll(0.0)
    driver.submit(b"back")
    driver.poll(1.0)
    assert heard(station.poll(0.1)) == [b"back"]
    assert module.settings.bandwidth_hz == ROBOT.bandwidth_hz


def test_a_module_without_power_is_waited_for(pair: Pair) -> None:
    pair.modules[0].power_off()
    handle = pair.robot.submit(b"into the void")
    assert pair.fate(pair.robot, handle) == SendFailed(handle or 0, Failure.NO_REPLY)
    for _ in range(30):
        pair.robot.poll(1.0)
    assert not pair.robot.operating
    assert pair.robot.submit(b"not now") is None
    pair.modules[0].power_on()
    pair.robot.wait_until_operating(15.0)
    assert pair.modules[0].settings == ROBOT


def test_a_cut_during_the_configuration_is_survived() -> None:
    rig = Rig()
    module = rig.module("robot")
    driver = rig.driver(module, ROBOT)
    rng = np.random.default_rng(5)
    for _ in range(25):
        driver.poll(float(rng.uniform(0.0, 0.6)))
        module.power_off()
        driver.poll(float(rng.uniform(0.0, 0.2)))
        module.power_on()
    driver.wait_until_operating(30.0)
    assert module.settings == ROBOT


def test_a_module_that_loses_its_unsaved_baud_rate_is_found_again() -> None:
    fast = dataclasses.replace(ROBOT, baud_rate=230_400)
    pair = Pair(robot=fast)
    pair.modules[0].power_off()
    pair.modules[0].power_on()
    pair.robot.poll(1.0)
    handle = pair.robot.submit(b"x")
    assert pair.fate(pair.robot, handle) == SendFailed(handle or 0, Failure.NO_REPLY)
    pair.robot.wait_until_operating(30.0)
    assert pair.modules[0].settings == fast


def test_a_refused_setting_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Console, "_parsed", lambda *_: None)
    rig = Rig()
    event = rig.driver(rig.module("robot"), ROBOT).poll(10.0)[0]
    assert isinstance(event, Lost)
    assert "refuses `bw 6`: it does not have that value" in event.reason


def test_packets_of_another_network_are_counted_and_left(pair: Pair) -> None:
    pair.robot._core.feed(bytes((13,)) + b"FFC400090001x", pair.rig.clock.now_s())
    assert pair.robot.poll(0.0) == []
    assert pair.robot.statistics.foreign_packets == 1


def test_a_reply_to_nothing_is_counted(pair: Pair) -> None:
    pair.robot._core.feed(b"\x02OK\x06NG 101", pair.rig.clock.now_s())
    assert pair.robot.statistics.stray_replies == 2


def test_a_lost_port_is_an_error_that_names_it(pair: Pair) -> None:
    port = pair.robot._port
    port.unplug()  # type: ignore[attr-defined]
    with pytest.raises(LinkError, match="robot: unplugged"):
        pair.robot.poll(0.1)
    with pytest.raises(LinkError, match="robot: unplugged"):
        pair.robot.submit(b"x")
    pair.robot.close()
    pair.robot.close()


def test_a_silent_port_is_told_once_and_names_itself() -> None:
    rig = Rig()
    module = rig.module("robot")
    module.power_off()
    driver = rig.driver(module, ROBOT)
    events = []
    for _ in range(40):
        events += driver.poll(1.0)
    assert [type(e) for e in events] == [Lost]
    with pytest.raises(LinkError, match="robot: the radio module does not operate after 3 s"):
        driver.wait_until_operating(3.0)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"format": Format.ASCII}, "format=binary"),
        ({"show_rssi": False}, "show_rssi"),
        ({"show_sender": False}, "show_sender"),
        ({"transfer": Transfer.FRAME}, "transfer=payload"),
        ({"sleep": Sleep.TIMER}, "sleep=none"),
        ({"auto_send_interval_s": 3, "auto_send_text": "x"}, "auto_send_interval_s=0"),
    ],
)
def test_settings_with_which_no_link_works_are_refused(change: dict[str, object], told: str) -> None:
    with pytest.raises(SettingsError, match=told):
        Es920lrCore(dataclasses.replace(ROBOT, **change), LONG_CARRIER_SENSE, False, 0.0)  # type: ignore[arg-type]


def test_what_the_band_forbids_is_never_sent() -> None:
    slow = dataclasses.replace(ROBOT, bandwidth_hz=62_500, spreading_factor=12)
    core = Es920lrCore(slow, LONG_CARRIER_SENSE, False, 0.0)
    with pytest.raises(ValueError, match=r"5\.59 s in the air"):
        core.submit(bytes(50), 0.0)
    with pytest.raises(BandError):
        Es920lrCore(slow, SHORT_CARRIER_SENSE, False, 0.0)


def test_the_hour_of_the_short_rule_is_kept() -> None:
    rig = Rig()
    settings = dataclasses.replace(ROBOT, bandwidth_hz=125_000, spreading_factor=8)
    module = rig.module("robot", operating(settings))
    driver = Es920lr(rig.port(module), settings, rig.clock, SHORT_CARRIER_SENSE)
    driver.wait_until_operating(5.0)
    driver._core._ledger.add(rig.clock.now_s(), 359.9)
    assert driver.submit(bytes(50)) is None
    rig.run(3_615.0)
    assert driver.submit(bytes(50)) is not None


def test_noise_on_the_line_does_no_harm(rng: np.random.Generator) -> None:
    """Everything the module may be heard saying, cut and changed, at any moment of the driver's life."""
    core = Es920lrCore(ROBOT, LONG_CARRIER_SENSE, True, 0.0)
    speech = [b"\x02OK", b"\x06NG 101", b"OK\r\n", b"NG 002\r\n", b"\r\n" + MODE_QUESTION, b"LORA > ", b"VER 1.12\r\n"]
    speech += [
        bytes((16,)) + b"FFC400010002data",
        b"\r\n  Node   : EndDevice\r\n",
        b"\xfc\xfc\xff",
        b"Send Data : \r\n\r\n",
    ]
    now_s, operated, taken = 0.0, 0, 0
    while taken < FUZZED_BYTES // 4:
        said = bytearray(speech[rng.integers(len(speech))])
        if rng.random() < 0.4:
            said[rng.integers(len(said))] = rng.integers(256)
        if rng.random() < 0.2:
            del said[: rng.integers(len(said))]
        if rng.random() < 0.1:
            said += rng.bytes(int(rng.integers(500)))
        taken += len(said)
        core.feed(bytes(said), now_s)
        if core.can_submit and rng.random() < 0.5:
            core.submit(rng.bytes(int(rng.integers(1, 51))), now_s)
        for step in core.take_steps():
            assert not isinstance(step, Ask) or len(step.data) <= 64
        core.take_events()
        now_s += float(rng.choice((0.0, 0.001, 0.05, 0.3, 1.0)))
        core.tick(now_s)
        operated += core.operating
    assert operated > 1_000
    assert core.next_tick_s(now_s) >= now_s or not core.operating


def test_losses_do_not_disturb_the_sender(pair: Pair) -> None:
    pair.rig.channel.use_loss(lambda: Independent(0.5))
    for _ in range(40):
        assert isinstance(pair.fate(pair.robot, pair.robot.submit(b"half of these")), Sent)
    assert 10 <= len(polled(pair.station, 40)) <= 30


def test_what_comes_while_it_sends_is_not_heard(pair: Pair) -> None:
    pair.robot.submit(bytes(50))
    pair.station.submit(bytes(50))  # at the same moment, neither hears the other's carrier yet
    for driver in (pair.robot, pair.station):
        while driver.busy:
            driver.poll(0.1)
    assert heard(pair.robot.poll(0.1)) == heard(pair.station.poll(0.1)) == []


def test_modules_saved_for_operation_start_without_being_configured() -> None:
    rig = Rig()
    module = rig.module("robot", dataclasses.replace(operating(ROBOT), boot_mode=BootMode.OPERATION))
    driver = rig.driver(module, ROBOT)
    driver.wait_until_operating(2.0)
    listen(driver._port, 0.1)  # type: ignore[arg-type]
    assert module.flash_writes == 0
