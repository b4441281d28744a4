import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.geometry.ackermann import CarGeometry
from shared.geometry.se2 import Pose2, wrap_angle
from station_gui.mapping.snapshot import GridMap
from station_gui.planning.config import LatticeConfig, PlannerConfig, TreeConfig
from station_gui.planning.path_planner import PathPlanner, Plan, PlanningError, Refusal

CAR = CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.20)
FREE, OCCUPIED, UNKNOWN = 0.05, 0.95, 0.5
CELL_M = 0.02


def _grid(*boxes: tuple[float, float, float, float]) -> GridMap:
    """A free room of 4 x 4 m from the origin, walls round it, boxes (x0, y0, x1, y1) in it, unknown beyond."""
    probability = np.full((220, 220), UNKNOWN, np.float32)
    probability[8:212, 8:212] = OCCUPIED
    probability[10:210, 10:210] = FREE
    grid = GridMap(probability, (-0.2, -0.2), CELL_M)
    for box in boxes:
        _paint(grid, box, OCCUPIED)
    return grid


def _paint(grid: GridMap, box: tuple[float, float, float, float], value: float) -> None:
    x0, y0, x1, y1 = (round((v + 0.2) / CELL_M) for v in box)
    grid.probability[y0:y1, x0:x1] = value


def _touched(path: NDArray[np.float64], grid: GridMap) -> bool:
    """Whether the car's true rectangle ever covers the middle of an occupied cell."""
    occupied = grid.occupied_m()
    for pose in path:
        at = Pose2.from_array(pose).inverse().apply(occupied)
        inside = (at[:, 0] > -CAR.rear_m) & (at[:, 0] < CAR.front_m) & (np.abs(at[:, 1]) < CAR.width_m / 2)
        if inside.any():
            return True
    return False


def _never() -> float:
    """A clock that stands: no time is ever up."""
    return 0.0


def _plan(grid: GridMap, start: Pose2, goal: tuple[float, float], heading: float | None = None) -> Plan:
    return PathPlanner(CAR, PlannerConfig(), _never).plan(grid, start, goal, heading)


def test_the_path_goes_round_an_obstacle_without_touching_it() -> None:
    grid = _grid((1.5, 0.8, 2.0, 4.0))
    plan = _plan(grid, Pose2(0.7, 3.0, -1.57), (3.2, 3.0))
    np.testing.assert_allclose(plan.path[0], [0.7, 3.0, -1.57], atol=1e-9)
    np.testing.assert_allclose(plan.path[-1, :2], [3.2, 3.0], atol=1e-6)
    assert not _touched(plan.path, grid)
    assert plan.clearance_m >= 0.05
    assert plan.length_m == pytest.approx(float(np.hypot(*np.diff(plan.path[:, :2], axis=0).T).sum()), abs=0.02)


def test_points_of_the_path_are_close_and_the_car_can_turn_as_they_do() -> None:
    plan = _plan(_grid((1.5, 0.8, 2.0, 4.0)), Pose2(0.7, 3.0, 1.57), (3.2, 3.0), 1.57)
    for a, b in pairwise(plan.path):
        way = math.hypot(*(b - a)[:2])
        assert way <= 0.05
        assert abs(wrap_angle(b[2] - a[2])) <= way / CAR.min_turning_radius_m + 1e-3
        along = (b - a)[0] * math.cos((a[2] + b[2]) / 2) + (b - a)[1] * math.sin((a[2] + b[2]) / 2)
        assert abs(abs(along) - way) < 1e-3 or abs(wrap_angle(b[2] - a[2])) > 3.0


def test_a_wanted_heading_at_the_goal_is_reached() -> None:
    plan = _plan(_grid(), Pose2(1.0, 1.0, 0.0), (3.0, 3.0), math.pi / 2)
    assert wrap_angle(plan.path[-1, 2] - math.pi / 2) == pytest.approx(0.0, abs=1e-6)


def test_in_a_corridor_too_narrow_to_turn_the_car_turns_with_cusps() -> None:
    grid = _grid((0.0, 0.0, 4.0, 1.5), (0.0, 2.4, 4.0, 4.0))
    plan = _plan(grid, Pose2(2.0, 1.95, 0.0), (2.0, 1.95), math.pi)
    steps = np.diff(plan.path[:, :2], axis=0)
    forward = steps[:, 0] * np.cos(plan.path[:-1, 2]) + steps[:, 1] * np.sin(plan.path[:-1, 2]) > 0
    assert np.count_nonzero(np.diff(forward)) >= 2
    assert not _touched(plan.path, grid)


def test_a_goal_just_behind_the_car_is_reached_in_reverse() -> None:
    plan = _plan(_grid(), Pose2(2.0, 2.0, 0.3), (2.0 - 0.6 * math.cos(0.3), 2.0 - 0.6 * math.sin(0.3)))
    assert plan.length_m == pytest.approx(0.6, abs=0.02)
    np.testing.assert_allclose(plan.path[:, 2], 0.3, atol=1e-6)


@pytest.mark.parametrize(
    ("goal", "refusal"),
    [
        ((9.0, 1.0), Refusal.OUTSIDE_MAP),
        ((-0.15, 2.0), Refusal.UNKNOWN),
        ((1.8, 2.0), Refusal.OCCUPIED),
        ((1.45, 2.0), Refusal.TOO_NEAR),
        ((3.5, 3.5), Refusal.NO_WAY),
    ],
)
def test_a_goal_that_cannot_be_reached_is_refused_with_its_reason(goal: tuple[float, float], refusal: Refusal) -> None:
    grid = _grid((1.5, 1.5, 2.0, 2.5), (3.0, 2.9, 3.1, 4.0), (3.0, 2.9, 4.0, 3.0))
    with pytest.raises(PlanningError) as caught:
        _plan(grid, Pose2(0.7, 0.7, 0.0), goal)
    assert caught.value.refusal is refusal


def test_unknown_space_is_not_crossed() -> None:
    grid = _grid()
    _paint(grid, (1.8, 0.0, 2.1, 4.0), UNKNOWN)
    with pytest.raises(PlanningError, match="no way"):
        _plan(grid, Pose2(0.7, 2.0, 0.0), (3.2, 2.0))


def test_a_speck_that_no_beam_has_hit_does_not_close_the_way() -> None:
    grid = _grid()
    _paint(grid, (1.98, 1.98, 2.02, 2.02), UNKNOWN)
    assert _plan(grid, Pose2(0.7, 2.0, 0.0), (3.2, 2.0)).length_m == pytest.approx(2.5, abs=0.01)


def test_a_robot_a_little_too_near_to_a_wall_may_leave_it() -> None:
    start = Pose2(1.0, 0.115, 0.0)  # its side is 1.5 cm from the wall
    plan = _plan(_grid(), start, (3.0, 2.0))
    np.testing.assert_allclose(plan.path[-1, :2], [3.0, 2.0], atol=1e-6)


def test_a_robot_that_does_not_know_what_is_under_it_can_start() -> None:
    grid = _grid()
    _paint(grid, (0.9, 1.86, 1.36, 2.14), UNKNOWN)
    assert _plan(grid, Pose2(1.0, 2.0, 0.0), (3.0, 2.0)).length_m == pytest.approx(2.0, abs=0.01)


def test_a_path_is_no_longer_free_when_something_comes_to_stand_in_it() -> None:
    grid = _grid()
    planner = PathPlanner(CAR, PlannerConfig())
    plan = planner.plan(grid, Pose2(0.7, 2.0, 0.0), (3.2, 2.0))
    assert planner.path_is_free(plan.path, grid)
    assert not planner.path_is_free(plan.path, _grid((2.0, 1.9, 2.2, 2.1)))
    assert planner.path_is_free(plan.path[-10:], _grid((2.0, 1.9, 2.2, 2.1)))


def test_the_same_map_gives_the_same_path_to_the_last_bit() -> None:
    grid = _grid((1.5, 0.8, 2.0, 4.0))
    first = _plan(grid, Pose2(0.7, 3.0, 1.0), (3.2, 3.0))
    second = _plan(grid, Pose2(0.7, 3.0, 1.0), (3.2, 3.0))
    np.testing.assert_array_equal(first.path, second.path)


def test_rrt_as_in_the_paper_finds_a_path_too_though_a_dearer_one() -> None:
    grid, start, goal = _grid((1.5, 0.8, 2.0, 4.0)), Pose2(0.7, 3.0, -1.57), (3.2, 3.0)
    plan = PathPlanner(CAR, PlannerConfig(method="rrt"), _never).plan(grid, start, goal)
    np.testing.assert_allclose(plan.path[-1, :2], goal, atol=1e-6)
    assert not _touched(plan.path, grid)
    assert plan.cost_m >= _plan(grid, start, goal).cost_m


def test_another_seed_may_take_another_path_but_not_a_much_dearer_one() -> None:
    grid, start, goal = _grid((1.5, 0.8, 2.0, 4.0)), Pose2(0.7, 3.0, -1.57), (3.2, 3.0)
    costs = [
        PathPlanner(CAR, PlannerConfig(tree=TreeConfig(seed=seed)), _never).plan(grid, start, goal).cost_m
        for seed in (1, 2, 3)
    ]
    assert max(costs) < 1.05 * min(costs)


def test_when_the_time_is_up_the_best_way_so_far_is_taken_and_without_one_the_goal_is_refused() -> None:
    grid, start, goal = _grid((1.5, 0.8, 2.0, 4.0)), Pose2(0.7, 3.0, -1.57), (3.2, 3.0)
    hurried = PathPlanner(CAR, PlannerConfig(timeout_s=0.0), _Ticking()).plan(grid, start, goal)
    np.testing.assert_allclose(hurried.path[-1, :2], goal, atol=1e-6)
    assert hurried.cost_m >= _plan(grid, start, goal).cost_m
    with pytest.raises(PlanningError, match="in time"):
        PathPlanner(CAR, PlannerConfig(timeout_s=0.0, give_up_s=0.0), _Ticking()).plan(grid, start, goal)


class _Ticking:
    """A clock that goes on by a millisecond at each look."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def __call__(self) -> float:
        self._now_s += 0.001
        return self._now_s


def test_the_true_rectangle_passes_where_a_circle_round_the_car_would_not() -> None:
    grid = _grid((1.8, 0.0, 2.2, 1.82), (1.8, 2.18, 2.2, 4.0))  # a gap of 36 cm
    plan = _plan(grid, Pose2(0.7, 2.0, 0.0), (3.2, 2.0))
    assert plan.length_m == pytest.approx(2.5, abs=0.02)
    assert plan.clearance_m == pytest.approx(0.08, abs=0.012)
    assert plan.clearance_m >= PlannerConfig().margin_m


def test_a_goal_near_a_wall_is_reached_with_the_rear_to_it_and_nearer_ones_are_refused() -> None:
    """The rear axle stands 4.5 cm before the rear bumper, but half a width from the sides."""
    grid, start = _grid(), Pose2(2.0, 2.0, 0.0)
    plan = _plan(grid, start, (0.11, 2.0))
    assert abs(wrap_angle(plan.path[-1, 2])) < 0.3
    assert not _touched(plan.path, grid)
    with pytest.raises(PlanningError, match="too near"):
        _plan(grid, start, (0.07, 2.0))


def test_a_goal_in_a_niche_hardly_wider_than_the_car_is_reached_or_refused_wherever_the_niche_is() -> None:
    for shift in (0.0, 0.02, 0.04):
        for gap in (0.28, 0.30, 0.32, 0.34):
            low, high = 2.0 + shift - gap / 2, 2.0 + shift + gap / 2
            grid = _grid((3.0, 0.0, 4.0, low), (3.0, high, 4.0, 4.0))
            try:
                plan = _plan(grid, Pose2(1.0, 1.0, 0.5), (3.3, 2.0 + shift))
            except PlanningError:
                continue
            assert not _touched(plan.path, grid)
            assert math.isfinite(plan.cost_m)


def test_a_goal_that_the_car_could_not_get_away_from_is_refused_without_a_search_of_the_room() -> None:
    """A pen of 80 cm with a gap through which the rear axle passes, but not the car with its margin."""
    grid = _grid((2.6, 1.6, 2.64, 2.4), (3.4, 1.6, 3.44, 2.4), (2.6, 1.56, 3.44, 1.6), (2.6, 2.4, 3.44, 2.44))
    _paint(grid, (2.6, 1.88, 2.64, 2.12), FREE)
    config = PlannerConfig(lattice=LatticeConfig(max_expansions=1), tree=TreeConfig(first_samples=200))
    with pytest.raises(PlanningError) as caught:
        PathPlanner(CAR, config, _never).plan(grid, Pose2(0.7, 2.0, 0.0), (3.1, 2.0))
    assert caught.value.refusal is Refusal.NO_WAY
