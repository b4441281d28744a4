from __future__ import annotations

import numpy as np
import pytest

from station_gui.mapping.slam2d.particle.resampling import effective_number, normalised, systematic


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
