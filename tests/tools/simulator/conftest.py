from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from tools.simulator.scenario import CameraParameters, EncoderParameters, Item, ScannerParameters, Scenario, Start


@pytest.fixture
def room() -> Callable[..., Scenario]:
    """Makes a room of 3.95 x 4.2 m with the given items and a car at (1, 2) that looks along x."""

    def make(*items: Item, start: Start | None = None) -> Scenario:
        return Scenario(name="test", start=start or Start((1.0, 2.0)), items=items)

    return make


@pytest.fixture
def quiet() -> Callable[[Scenario], Scenario]:
    """The same scenario with perfect devices, rounding apart."""

    def make(scenario: Scenario) -> Scenario:
        scanner = ScannerParameters(
            sigma_m=0.0,
            sigma_fraction=0.0,
            bias_m=0.0,
            dropout=0.0,
            edge_lost=0.0,
            edge_mixed=0.0,
            min_signal_per_m2=1e-9,
        )
        camera = CameraParameters(
            sigma_at_1m_m=0.0, sigma_at_9m_m=0.0, dropout=0.0, edge_lost=0.0, edge_flying=0.0, min_signal_per_m2=1e-9
        )
        encoders = EncoderParameters(left_scale_error=0.0, right_scale_error=0.0)
        return replace(scenario, scanner=scanner, camera=camera, encoders=encoders)

    return make
