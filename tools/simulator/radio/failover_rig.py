"""Robot and station with Wi-Fi that can be cut and two emulated modules each, on a manual clock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shared.link.es920lr.settings import RadioSettings
from shared.link.failover.link import Failover
from shared.link.failover.watch import FailoverConfig
from shared.link.radio_pair.config import PairConfig
from shared.runtime.clock import ManualClock
from tools.simulator.radio.loss import Independent, LossModel
from tools.simulator.radio.pair_rig import PairRig
from tools.simulator.wifi import CuttableWifi

HOT = PairConfig(turn_s=0.18, idle_turn_s=0.15)  # a command shall not wait long for its turn when Wi-Fi has just gone


class FailoverRig:
    """`robot` and `station` are links; `run` moves the time."""

    def __init__(
        self,
        seed: int,
        pair: PairConfig = HOT,
        config: FailoverConfig | None = None,
        loss: Callable[[], LossModel] = Independent,
        settings: RadioSettings | None = None,
        clock: ManualClock | None = None,
        steps: bool = True,
    ) -> None:
        """`steps`: move the failover at each event; without, it moves when it is asked for what has come."""
        self.radios = PairRig(seed, settings, pair, loss, clock=clock)
        self.clock = self.radios.clock
        self.rng = np.random.default_rng(seed + 100)
        self.wifi = CuttableWifi(self.clock, self.rng)
        self.config = config
        self.robot = Failover(self.wifi.robot_end, self.radios.robot, self.clock, self.rng.bytes, config)
        self.station = Failover(self.wifi.connect, self.radios.station, self.clock, self.rng.bytes, config)
        self.at_each_event: Callable[[], None] = lambda: None
        if steps:
            self.radios.at_each_event = self._step

    def restart_station(self) -> None:
        """Another program on the station."""
        self.station.close()
        radio = self.radios.make_station()
        self.station = Failover(self.wifi.connect, radio, self.clock, self.rng.bytes, self.config)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        return self.radios.run(seconds, until)

    def _step(self) -> None:
        self.robot.step()
        self.station.step()
        self.at_each_event()
