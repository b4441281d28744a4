from __future__ import annotations

import numpy as np
import pytest

from station_gui.mapping.slam2d.particle.resampling import Weights, effective_number, normalised, systematic


def test_the_effective_number_goes_from_one_to_all() -> None:
    assert effective_number(np.full(30, 1 / 30)) == pytest.approx(30.0)
    assert effective_number(np.eye(30)[7]) == pytest.approx(1.0)
    assert effective_number(np.array([0.5, 0.5, 0.0, 0.0])) == pytest.approx(2.0)


def test_weights_far_below_the_range_of_numbers_are_normalised() -> None:
    weights = normalised(np.array([-5000.0, -5000.0 + np.log(3.0)]))
    np.testing.assert_allclose(weights, [0.25, 0.75])


def test_a_particle_has_as_many_children_as_its_weight_says_in_the_mean() -> None:
    rng = np.random.default_rng(5)
    weights = normalised(rng.normal(0.0, 1.5, 12))
    children = np.mean([np.bincount(systematic(weights, u), minlength=12) for u in rng.random(20_000)], axis=0)
    np.testing.assert_allclose(children, 12 * weights, atol=0.02)


def test_no_draw_gives_more_than_one_child_too_many_or_too_few() -> None:
    rng = np.random.default_rng(6)
    weights = normalised(rng.normal(0.0, 1.5, 30))
    for offset in rng.random(200):
        children = np.bincount(systematic(weights, offset), minlength=30)
        assert (np.abs(children - 30 * weights) < 1.0).all()


def test_equal_weights_keep_every_particle_and_one_weight_takes_all() -> None:
    np.testing.assert_array_equal(systematic(np.full(30, 1 / 30), 0.5), np.arange(30))
    np.testing.assert_array_equal(systematic(np.eye(30)[4], 0.999999), np.full(30, 4))


def test_weights_count_the_resamplings_and_how_evenly_they_are_spread() -> None:
    weights = Weights(4, independent_share=0.5, resample_share=0.5)
    assert weights.effective_share == 1.0

    assert not weights.weigh(np.zeros(4))
    assert weights.weigh(np.array([-2000.0, 0.0, -2000.0, -2000.0]))

    assert weights.effective_share == pytest.approx((1.0 + 0.25) / 2)
    np.testing.assert_array_equal(weights.parents(0.3), [1, 1, 1, 1])
    assert weights.resamplings == 1
    assert not weights.weigh(np.zeros(4))  # the children weigh the same


def test_a_factor_counts_with_the_share_of_beams_that_are_independent() -> None:
    weights = Weights(2, independent_share=0.01, resample_share=0.5)
    weights.weigh(np.array([100.0 * np.log(3.0), 0.0]))
    assert weights.effective_share == pytest.approx(1.0 / (0.75**2 + 0.25**2) / 2)


def test_the_best_particle_has_the_likeliest_path_also_after_resampling() -> None:
    weights = Weights(3, independent_share=1.0, resample_share=0.5)
    weights.weigh(np.array([-1.0, 0.0, -5.0]))
    weights.adopt(np.array([0, 0, 1]))
    assert weights.best() == 2
    assert weights.best(np.array([True, True, False])) == 0
