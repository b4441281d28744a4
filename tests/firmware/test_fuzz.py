"""A short run of `tools.fuzz_transceiver`; the long one is for the command line."""

from __future__ import annotations

import numpy as np

from tools.fuzz_transceiver import fuzz
from tools.simulator.devices.mega_core import Core


def test_neither_side_minds_foreign_bytes(core: Core, rng: np.random.Generator) -> None:
    result = fuzz(core, 400_000, rng)
    assert result.core_frames > 2_000
    assert result.host_frames > 3_000
    assert result.host_sessions > 1
