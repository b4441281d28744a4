"""The air: ranges, collisions, losses, and the same every time."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from shared.link.es920lr.airtime import Modulation
from shared.runtime.clock import ManualClock
from tools.simulator.radio.channel import Antenna, RadioChannel, RadioFrame, Tuning
from tools.simulator.radio.loss import Bursts, Independent
from tools.simulator.radio.propagation import Propagation, sensitivity_dbm
from tools.simulator.radio.timeline import Timeline

FAST = Modulation(500_000, 7)
FIRST = Tuning(920_800_000, FAST)
FIFTH = Tuning(923_200_000, FAST)
SLOW = Tuning(920_800_000, Modulation(500_000, 8))


class Air:
    def __init__(self, **parameters: object) -> None:
        self.clock = ManualClock()
        self.timeline = Timeline(self.clock)
        self.channel = RadioChannel(self.timeline, np.random.default_rng(7), **parameters)  # type: ignore[arg-type]
        self.heard: list[tuple[str, int, float]] = []

    def antenna(self, name: str, tuning: Tuning = FIRST, x_m: float = 0.0) -> Antenna:
        def hear(frame: RadioFrame, power_dbm: float) -> None:
            self.heard.append((name, frame.sequence, power_dbm))

        antenna = Antenna(name, hear, (x_m, 0.0))
        antenna.listen(tuning, self.timeline.now_s)
        self.channel.attach(antenna)
        return antenna

    def send(self, antenna: Antenna, sequence: int, at_s: float = 0.0, airtime_s: float = 0.0385) -> None:
        frame = RadioFrame(1, 2, 3, sequence, payload=b"x")

        def done() -> None:
            assert antenna.tuning is not None
            antenna.listen(antenna.tuning, self.timeline.now_s)

        self.timeline.at(at_s, lambda: self.channel.transmit(antenna, frame, 13.0, airtime_s, done) and None)

    def pass_by(self, seconds: float) -> None:
        self.clock.advance(seconds)
        self.timeline.run()

    @property
    def arrived(self) -> list[tuple[str, int]]:
        return [(name, sequence) for name, sequence, _ in self.heard]


def test_everybody_in_reach_on_the_channel_hears_a_packet() -> None:
    air = Air()
    sender = air.antenna("sender")
    for name, tuning in (("same", FIRST), ("other channel", FIFTH), ("other factor", SLOW)):
        air.antenna(name, tuning, x_m=10.0)
    air.send(sender, 1)
    air.pass_by(0.038)
    assert air.arrived == []
    air.pass_by(0.001)
    assert air.heard == [("same", 1, pytest.approx(13.0 - 31.7 - 27.0))]


def test_two_packets_that_overlap_destroy_each_other() -> None:
    air = Air()
    first, second = air.antenna("first"), air.antenna("second", x_m=5.0)
    air.antenna("listener", x_m=10.0)
    air.send(first, 1, at_s=0.0)
    air.send(second, 2, at_s=0.03)
    air.pass_by(1.0)
    assert air.arrived == []
    assert air.channel.statistics.lost_to_collision == 2


@pytest.mark.parametrize("tuning", [FIFTH, SLOW])
def test_packets_of_other_channels_and_factors_do_not_disturb(tuning: Tuning) -> None:
    air = Air()
    first, second = air.antenna("first"), air.antenna("second", tuning)
    air.antenna("listener", x_m=10.0)
    air.send(first, 1)
    air.send(second, 2)
    air.pass_by(1.0)
    assert air.arrived == [("listener", 1)]


def test_a_packet_too_far_away_to_be_heard_destroys_nothing() -> None:
    air = Air()
    near, far = air.antenna("near"), air.antenna("far", x_m=20_000.0)
    air.antenna("listener", x_m=10.0)
    air.send(near, 1)
    air.send(far, 2)
    air.pass_by(1.0)
    assert air.arrived == [("listener", 1)]


def test_who_sends_hears_nothing_meanwhile() -> None:
    air = Air()
    first, second = air.antenna("first"), air.antenna("second", x_m=5.0)
    air.send(first, 1)
    air.send(second, 2, at_s=0.01)
    air.pass_by(1.0)
    assert air.arrived == []


def test_who_begins_to_listen_after_the_preamble_hears_nothing() -> None:
    for late_s, hears in ((0.0007, True), (0.0010, False)):  # three symbols are 0.77 ms
        air = Air()
        sender, listener = air.antenna("sender"), air.antenna("listener", x_m=5.0)
        air.send(sender, 1)
        air.timeline.at(late_s, lambda who=listener, t=air.timeline: who.listen(FIRST, t.now_s))  # type: ignore[misc]
        air.pass_by(1.0)
        assert (air.arrived != []) is hears


def test_a_sender_that_loses_its_power_is_not_heard() -> None:
    air = Air()
    sender = air.antenna("sender")
    air.antenna("listener", x_m=5.0)
    transmission = air.channel.transmit(sender, RadioFrame(1, 2, 3, 1), 13.0, 0.0385, lambda: None)
    air.pass_by(0.03)
    air.channel.cut_short(transmission)
    air.pass_by(1.0)
    assert air.arrived == []
    assert air.channel.statistics.airtime_s == pytest.approx(0.03)


def test_carrier_sense_hears_whatever_is_in_the_band() -> None:
    air = Air()
    sender, listener = air.antenna("sender", SLOW), air.antenna("listener", x_m=10.0)
    air.send(sender, 1)
    air.pass_by(0.02)
    assert air.channel.strongest_dbm(listener, FIRST, 0.0, 0.02) == pytest.approx(-45.7)
    assert air.channel.strongest_dbm(listener, FIFTH, 0.0, 0.02) == -np.inf
    assert air.channel.strongest_dbm(sender, FIRST, 0.0, 0.02) == -np.inf
    air.pass_by(1.0)
    assert air.channel.strongest_dbm(listener, FIRST, 0.5, 1.0) == -np.inf


@pytest.mark.parametrize("spreading_factor", [7, 9, 12])
def test_each_spreading_factor_reaches_as_far_as_its_sensitivity(spreading_factor: int) -> None:
    modulation = Modulation(500_000, spreading_factor)
    tuning = Tuning(920_800_000, modulation)
    reach_m = Propagation().range_m(13.0, modulation)
    for x_m, hears in ((reach_m * 0.99, True), (reach_m * 1.01, False)):
        air = Air()
        sender = air.antenna("sender", tuning)
        air.antenna("listener", tuning, x_m)
        air.send(sender, 1)
        air.pass_by(1.0)
        assert (air.arrived != []) is hears


def test_sensitivities_are_those_of_the_datasheet() -> None:
    """SX1276 datasheet, table 10, band 1: to 2 dB."""
    table = {(125_000, 7): -123, (125_000, 12): -136, (250_000, 7): -120, (500_000, 7): -116, (500_000, 12): -130}
    for (bandwidth_hz, factor), expected_dbm in table.items():
        assert sensitivity_dbm(Modulation(bandwidth_hz, factor)) == pytest.approx(expected_dbm, abs=3.0)


def test_shadowing_spreads_what_arrives() -> None:
    air = Air(propagation=Propagation(shadowing_db=6.0))
    sender = air.antenna("sender")
    air.antenna("listener", x_m=10.0)
    for i in range(300):
        air.send(sender, i, at_s=i * 0.1)
    air.pass_by(60.0)
    assert np.std([power for *_, power in air.heard]) == pytest.approx(6.0, rel=0.15)


def lost_share(air: Air, packets: int, period_s: float) -> tuple[float, list[bool]]:
    sender = air.antenna("sender")
    air.antenna("listener", x_m=10.0)
    for i in range(packets):
        air.send(sender, i, at_s=i * period_s)
    air.pass_by(packets * period_s + 1.0)
    came = {sequence for _, sequence in air.arrived}
    return 1.0 - len(came) / packets, [i not in came for i in range(packets)]


def test_independent_losses_are_as_many_as_asked_for() -> None:
    share, lost = lost_share(Air(loss=lambda: Independent(0.2)), 5_000, 0.1)
    assert share == pytest.approx(0.2, abs=0.02)
    after_loss = [b for a, b in itertools.pairwise(lost) if a]
    assert np.mean(after_loss) == pytest.approx(0.2, abs=0.05)


def test_bursts_lose_as_much_and_all_at_once() -> None:
    share, lost = lost_share(Air(loss=lambda: Bursts(mean_good_s=4.0, mean_bad_s=1.0)), 20_000, 0.1)
    assert share == pytest.approx(0.2, abs=0.03)
    after_loss = [b for a, b in itertools.pairwise(lost) if a]
    assert np.mean(after_loss) == pytest.approx(np.exp(-0.1 * (1 / 1.0 + 1 / 4.0)), abs=0.05)


def test_both_directions_lose_on_their_own() -> None:
    air = Air(loss=lambda: Bursts(1.0, 1.0))
    ends = air.antenna("first"), air.antenna("second", x_m=10.0)
    for i in range(400):
        air.send(ends[i % 2], i, at_s=i * 0.1)
    air.pass_by(60.0)
    lost = [i not in {s for _, s in air.arrived} for i in range(400)]
    assert np.corrcoef(lost[::2], lost[1::2])[0, 1] < 0.8


@pytest.mark.parametrize("bad", [-0.1, 1.1])
def test_probabilities_are_checked(bad: float) -> None:
    with pytest.raises(ValueError, match="0 to 1"):
        Independent(bad)
    with pytest.raises(ValueError, match="0 to 1"):
        Bursts(1.0, 1.0, bad_loss=bad)
    with pytest.raises(ValueError, match="positive"):
        Bursts(0.0, 1.0)


def test_the_same_seed_gives_the_same_air() -> None:
    runs = [lost_share(Air(loss=lambda: Bursts(2.0, 1.0, 0.1, 0.9)), 500, 0.1)[1] for _ in range(2)]
    assert runs[0] == runs[1]


def test_names_of_antennas_differ() -> None:
    air = Air()
    air.antenna("one")
    with pytest.raises(ValueError, match="already"):
        air.antenna("one")


def test_events_happen_at_their_own_times_and_in_order() -> None:
    clock = ManualClock()
    timeline, seen = Timeline(clock), []
    timeline.after(0.2, lambda: seen.append(("b", timeline.now_s)))
    timeline.after(0.1, lambda: timeline.after(0.05, lambda: seen.append(("a", timeline.now_s))) and None)
    timeline.after(0.2, lambda: seen.append(("c", timeline.now_s)))
    timeline.after(0.3, lambda: seen.append(("never", 0.0))).cancel()
    clock.advance(10.0)
    timeline.run()
    assert seen == [("a", pytest.approx(0.15)), ("b", 0.2), ("c", 0.2)]
    assert timeline.now_s == 10.0
