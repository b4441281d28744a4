from __future__ import annotations

import math

import numpy as np
import pytest

from robot_app.drivers.base import RawScan
from robot_app.sensing.scan_filter import ScanFilterConfig, thin, thinned_geometry
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry

GEOMETRY = ScanGeometry(-2.0, math.tau / 1024, 0.04 / 1024, 0.06, 4.0, Pose2())


def thinned(*ranges: float) -> list[float]:
    return thin(RawScan(1.0, np.array(ranges, np.float32)), GEOMETRY, ScanFilterConfig()).ranges_m.tolist()


def test_a_full_scan_becomes_a_third_of_its_beams() -> None:
    assert len(thinned(*[1.0] * 682)) == 227


def test_three_beams_on_one_surface_give_their_mean() -> None:
    assert thinned(1.00, 1.01, 1.05) == [pytest.approx(1.02)]


def test_a_mixed_pixel_between_two_surfaces_is_dropped() -> None:
    assert thinned(1.0, 1.5, 2.0) == [pytest.approx(math.nan, nan_ok=True)]


def test_at_an_edge_the_middle_beam_is_kept_as_it_is() -> None:
    assert thinned(1.0, 1.01, 2.0) == [pytest.approx(1.01)]
    assert thinned(math.nan, 1.01, 1.02) == [pytest.approx(1.01)]


def test_codes_outside_of_the_range_are_no_measurements() -> None:
    assert thinned(0.019, 0.019, 0.019, 4.095, 4.095, 4.095) == [pytest.approx(math.nan, nan_ok=True)] * 2


def test_the_mean_hides_noise(rng: np.random.Generator) -> None:
    noisy = (2.0 + rng.normal(0, 0.01, 681)).astype(np.float32)
    kept = np.array(thinned(*noisy))
    assert np.nanstd(kept) < 0.007


def test_the_thinned_beams_point_where_their_middle_ones_did() -> None:
    thin_geometry = thinned_geometry(GEOMETRY)
    np.testing.assert_allclose(thin_geometry.angles_rad(227), GEOMETRY.angles_rad(681)[1::3])
    assert thin_geometry.beam_interval_s == pytest.approx(3 * GEOMETRY.beam_interval_s)
    assert thin(RawScan(1.0, np.ones(6, np.float32)), GEOMETRY, ScanFilterConfig()).stamp_s == pytest.approx(
        1.0 + GEOMETRY.beam_interval_s
    )
