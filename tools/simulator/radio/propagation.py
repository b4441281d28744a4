"""How strong a packet arrives, and how strong it must be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from shared.link.es920lr.airtime import Modulation

_FIRST_METRE_DB = 31.7  # free space at 920 MHz
_NEAREST_M = 0.1
_THERMAL_DBM_HZ = -174.0
_NOISE_FIGURE_DB = 6.0  # SX1276
_LEAST_SNR_DB = {7: -7.5, 8: -10.0, 9: -12.5, 10: -15.0, 11: -17.5, 12: -20.0}  # SX1276 datasheet, table 13


@dataclass(frozen=True, slots=True)
class Propagation:
    """Log-distance path loss with log-normal shadowing, drawn anew for each packet and receiver."""

    exponent: float = 2.7  # between free space (2) and a building with walls (3 to 4)
    shadowing_db: float = 0.0
    antenna_gain_dbi: float = 0.0

    def mean_dbm(self, power_dbm: float, distance_m: float) -> float:
        """Received power without shadowing."""
        loss_db = _FIRST_METRE_DB + 10.0 * self.exponent * math.log10(max(distance_m, _NEAREST_M))
        return power_dbm + 2.0 * self.antenna_gain_dbi - loss_db

    def received_dbm(self, power_dbm: float, distance_m: float, rng: np.random.Generator) -> float:
        shadow_db = float(rng.normal(0.0, self.shadowing_db)) if self.shadowing_db > 0 else 0.0
        return self.mean_dbm(power_dbm, distance_m) + shadow_db

    def range_m(self, power_dbm: float, modulation: Modulation) -> float:
        """The distance at which a packet is just heard."""
        margin_db = power_dbm + 2.0 * self.antenna_gain_dbi - _FIRST_METRE_DB - sensitivity_dbm(modulation)
        return float(10.0 ** (margin_db / (10.0 * self.exponent)))


def sensitivity_dbm(modulation: Modulation) -> float:
    """The weakest packet that is heard: -118.5 dBm at SF7 and 500 kHz, -140 dBm at SF12 and 62.5 kHz."""
    noise_dbm = _THERMAL_DBM_HZ + 10.0 * math.log10(modulation.bandwidth_hz) + _NOISE_FIGURE_DB
    return noise_dbm + _LEAST_SNR_DB[modulation.spreading_factor]
