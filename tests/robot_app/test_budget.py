from __future__ import annotations

from robot_app.budget import Budget


def test_a_link_that_keeps_up_sets_no_limit() -> None:
    budget = Budget(8.0)
    for i in range(50):
        budget.sent(0.1 * i, 110, waited=False)
    assert budget.most_bytes >= 400


def test_a_slow_link_gives_each_observation_its_share_of_what_it_carries() -> None:
    budget, now_s = Budget(8.0), 0.0
    for _ in range(100):  # 500 bytes a second, and observations that would fill whatever they may
        size = min(110, budget.most_bytes)
        budget.sent(now_s, size, waited=True)
        now_s += size / 500
    assert 0.9 * 500 / 8 <= budget.most_bytes <= 1.2 * 500 / 8
    assert abs(budget.goodput_bps - 8 * 500) < 100


def test_a_keyframe_does_not_count_as_a_slow_link() -> None:
    budget, now_s = Budget(8.0), 0.0
    for i in range(40):
        size = 175 if i == 20 else 50
        budget.sent(now_s, size, waited=True)
        now_s += size / 600
    assert budget.most_bytes >= 70


def test_a_link_that_was_away_is_not_taken_for_a_slow_one() -> None:
    budget = Budget(8.0)
    budget.sent(0.0, 50, waited=False)
    budget.sent(30.0, 50, waited=True)
    assert budget.most_bytes >= 400


def test_however_slow_the_link_there_is_something_to_say() -> None:
    budget = Budget(8.0)
    for i in range(50):
        budget.sent(1.5 * i, 50, waited=True)
    assert budget.most_bytes == 40
