from __future__ import annotations

import numpy as np
import pytest

from station_gui.mapping.slam2d.particle.proposal.deviates import Deviates


def test_deviates_are_normal_and_alike_as_far_as_they_were_told() -> None:
    rng = np.random.default_rng(2)
    deviates = Deviates(400, alike_m=3.0)
    for _ in range(200):
        deviates.draw(rng, np.array([0.0, 0.1, 0.0]))
    before = deviates.draw(rng, np.array([0.1, 0.0, 0.0]))
    for _ in range(30):  # 3 m
        after = deviates.draw(rng, np.array([0.1, 0.0, 0.0]))
    assert after.mean() == pytest.approx(0.0, abs=0.1)
    assert after.std() == pytest.approx(1.0, abs=0.1)
    assert (before * after).mean() == pytest.approx(np.exp(-1.0), abs=0.1)


def test_children_begin_as_their_parents() -> None:
    deviates = Deviates(3, alike_m=3.0)
    drawn = deviates.draw(np.random.default_rng(0), np.array([1.0, 0.0, 0.0])).copy()
    deviates.adopt(np.array([2, 2, 0]))
    kept = deviates.draw(np.random.default_rng(0), np.zeros(3))
    np.testing.assert_array_equal(kept, drawn[[2, 2, 0]])


def test_a_particle_that_is_alone_draws_nothing() -> None:
    assert not Deviates(1, alike_m=3.0).draw(np.random.default_rng(0), np.array([1.0, 0.0, 0.0])).any()
