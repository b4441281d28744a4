"""Short runs of `python -m tools.fuzz --only core hex`; the long ones are for the command line."""

from __future__ import annotations

import numpy as np

from tests.firmware.benches import Bench
from tools.fuzz.base import fuzz
from tools.fuzz.transceiver import FirmwareCore, FirmwareHex
from tools.simulator.devices.mega_core import Core


def test_the_core_does_not_mind_foreign_bytes(core: Core, rng: np.random.Generator) -> None:
    assert fuzz(FirmwareCore(rng, core), 400_000).verdict.sound > 2_000


def test_the_hex_does_not_mind_foreign_bytes(bench: Bench, rng: np.random.Generator) -> None:
    assert fuzz(FirmwareHex(rng, bench.mega), 60_000).verdict.sound > 1_000
    bench.bring_up()
