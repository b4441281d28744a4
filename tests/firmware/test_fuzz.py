"""Short runs of `tools.fuzz_transceiver`; the long ones are for the command line."""

from __future__ import annotations

import numpy as np

from tests.firmware.benches import Bench
from tools.fuzz_transceiver import fuzz, fuzz_hex
from tools.simulator.devices.mega_core import Core


def test_neither_core_nor_host_minds_foreign_bytes(core: Core, rng: np.random.Generator) -> None:
    result = fuzz(core, 400_000, rng)
    assert result.core_frames > 2_000
    assert result.host_frames > 3_000
    assert result.host_sessions > 1


def test_the_hex_does_not_mind_foreign_bytes(bench: Bench, rng: np.random.Generator) -> None:
    assert fuzz_hex(bench.mega, 60_000, rng) > 1_000
    bench.bring_up()
