from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from robot_app.control.explorer import Explorer, ExplorerConfig, LegEnd, Task
from robot_app.control.ground._kernels import unseen_in_sight
from robot_app.control.ground.floor_map import FloorMap, FloorMapConfig
from robot_app.control.trail import Trail, TrailConfig
from robot_app.control.ways.ways import Ways, WaysBuffers, WaysConfig, path_room_m
from shared.geometry.ackermann import CarGeometry
from shared.geometry.rays import cast_rays
from shared.geometry.se2 import Pose2
from shared.messages import ScanGeometry

CAR = CarGeometry(0.26, 0.17, 0.04, 0.5, 0.305, 0.045, 0.2)
BEAMS = 227
STEP_RAD = math.radians(240) / (BEAMS - 1)
SCANNER = ScanGeometry(-math.radians(120), STEP_RAD, 0.0, 0.06, 4.0, Pose2(0.25, 0.0, 0.0))
FLOOR = FloorMapConfig(side_m=10.0)
CONFIG = ExplorerConfig(floor=FLOOR)


def box(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


YARD = np.array(box(-1.0, -1.0, 2.0, 1.0))
SCREENED = np.array([*box(-1.0, -1.0, 2.0, 1.0), *box(1.0, -1.0, 1.05, 0.2)])  # a wall with a way round its end


def scan(room: NDArray[np.float64], pose: Pose2) -> NDArray[np.float32]:
    scanner = pose @ SCANNER.robot_from_scanner
    ranges = np.empty(BEAMS)
    cast_rays(scanner.x_m, scanner.y_m, SCANNER.angles_rad(BEAMS) + scanner.theta_rad, room, 4.0, ranges)
    return ranges.astype(np.float32)


def seen_from(room: NDArray[np.float64], *poses: Pose2) -> FloorMap:
    floor = FloorMap(CAR, FLOOR)
    for pose in poses:
        for _ in range(3):
            floor.add_scan(scan(room, pose), SCANNER, pose)
    return floor


def view_m2(floor: FloorMap, pose: Pose2) -> float:
    return float(floor.views_m2(pose.as_array()[None], SCANNER, BEAMS)[0])


def drive(explorer: Explorer, room: NDArray[np.float64], start: Pose2, most_legs: int = 12) -> Pose2:
    """Along the legs of the explorer, by hand, until it has finished."""
    pose, way_m = start, 0.0
    for _ in range(most_legs):
        for _ in range(8):
            explorer.look(scan(room, pose), SCANNER, pose, way_m)
        explorer.step(pose, 0.0)
        leg = explorer.leg
        if explorer.finished or leg is None:
            break
        for row in leg.path[1:]:
            there = Pose2.from_array(row)
            way_m += there.distance_m(pose)
            pose = there
            explorer.look(scan(room, pose), SCANNER, pose, way_m)
        explorer.end(LegEnd(leg.number, arrived=True))
    return pose


def test_floor_that_beams_pass_is_seen_and_what_they_hit_stands_there() -> None:
    floor = seen_from(YARD, Pose2())
    assert 3.5 < floor.seen_m2 < 6.0
    things = floor.things_m(Pose2(), 1.2)
    assert len(things) > 20
    assert np.all(np.min(np.abs(np.column_stack((things[:, 0] + 1, np.abs(things[:, 1]) - 1))), axis=1) < 0.03)


def test_behind_a_screen_there_is_floor_to_be_seen_from_its_end() -> None:
    floor = seen_from(SCREENED, Pose2())
    here = view_m2(floor, Pose2())
    beyond = view_m2(floor, Pose2(1.2, 0.6, -math.pi / 2))
    assert beyond > 0.5
    assert beyond > 4 * here


@pytest.mark.parametrize(("gap_m", "shows"), [(0.075, False), (0.275, True)])
def test_floor_behind_a_gap_is_expected_where_two_beams_pass_it_side_by_side(gap_m: float, shows: bool) -> None:
    cells, cell_m, wall = 160, 0.025, 100
    evidence = np.zeros((cells, cells), np.int8)
    evidence[:, :wall], evidence[:, wall] = -8, 12
    half = round(gap_m / cell_m) // 2
    evidence[cells // 2 - half : cells // 2 + half + 1, wall : wall + 2] = -8
    scanner = np.array([-1.9, 0.5 * cell_m, 0.0])  # 2.4 m from the wall, its beams 8 cm apart there
    tries, marks = np.zeros((cells, cells), np.uint8), np.zeros((cells, cells), np.uint16)
    step_rad, beams = math.radians(2.0), 61
    found = unseen_in_sight(
        evidence, tries, 6, marks, 1, -2.0, cell_m, scanner, -step_rad * (beams // 2), step_rad, beams, 3.8
    )
    assert (found > 0) == shows


def test_what_should_be_seen_and_never_is_does_not_call_for_ever() -> None:
    floor = FloorMap(CAR, FLOOR)
    covered = np.full(BEAMS, np.nan, np.float32)
    before = view_m2(floor, Pose2())
    for _ in range(FLOOR.most_tries):
        floor.add_scan(covered, SCANNER, Pose2())
    assert before > 5.0
    assert view_m2(floor, Pose2()) < 0.1 * before


def test_every_path_keeps_the_body_on_floor_that_was_seen_and_off_things() -> None:
    floor = seen_from(SCREENED, Pose2(), Pose2(0.3, 0.5, 0.0))
    room = floor.room_for_body(Pose2(), 0.045)
    ways = Ways(CAR, WaysConfig(), room, Pose2(), 0.0, WaysBuffers(WaysConfig()))
    assert len(ways) > 500
    for node in np.linspace(1, len(ways) - 1, 40).astype(int).tolist():
        path = ways.path_to(node)
        assert np.allclose(path[-1], ways.poses[node])
        assert np.hypot(*np.diff(path[:, :2], axis=0).T).max() <= 0.041
        away = path[np.hypot(path[:, 0], path[:, 1]) > 0.5]  # nearer it may have as little room as at the start
        assert len(away) == 0 or path_room_m(CAR, room, away) > -0.03


def test_a_car_in_a_dead_end_backs_out_of_it() -> None:
    alley = np.array([*box(-1.5, -1.5, 1.0, 1.5), (0.1, 0.22, 1.0, 0.22), (0.1, -0.22, 1.0, -0.22)])
    floor = seen_from(alley, Pose2(-0.9, 0.0, 0.0), Pose2(-0.5, 0.0, 0.0), Pose2(0.0, 0.0, 0.0), Pose2(0.5, 0.0, 0.0))
    here, config = Pose2(0.5, 0.0, 0.0), WaysConfig()
    ways = Ways(CAR, config, floor.room_for_body(here, 0.045), here, 0.0, WaysBuffers(config))
    node = ways.nearest_to(Pose2(-0.8, 0.3, 0.0), 0.2, math.pi)
    assert node is not None
    path = ways.path_to(node)
    first = path[1, :2] - path[0, :2]
    assert first[0] < 0  # it faces the end


def test_the_explorer_sees_the_whole_yard_and_finishes() -> None:
    explorer = Explorer(CAR, CONFIG)
    explorer.begin(Task.EXPLORE, Pose2())
    drive(explorer, SCREENED, Pose2())
    assert explorer.finished
    assert explorer.found_way
    assert explorer.seen_m2 > 0.93 * 6.0 - 0.1


def test_a_view_that_only_a_few_poses_have_is_found_by_looking_more_densely(monkeypatch: pytest.MonkeyPatch) -> None:
    def views_m2(_floor: FloorMap, poses: NDArray[np.float64], _geometry: ScanGeometry, _beams: int) -> object:
        return np.where((np.hypot(poses[:, 0] - 0.95, poses[:, 1] - 0.1) < 0.05) & (poses[:, 2] > 0.4), 0.3, 0.0)

    monkeypatch.setattr(FloorMap, "views_m2", views_m2)
    explorers = Explorer(CAR, replace(CONFIG, finer=1)), Explorer(CAR, CONFIG)
    for explorer in explorers:
        explorer.begin(Task.EXPLORE, Pose2())
        for pose in (Pose2(0.4, 0.0, 0.0), Pose2(0.0, 0.0, 2.0), Pose2()):
            explorer.look(scan(YARD, pose), SCANNER, pose, 0.0)
        explorer.step(Pose2(), 0.0)
    assert explorers[0].finished
    leg = explorers[1].leg
    assert leg is not None
    assert math.hypot(leg.path[-1, 0] - 0.95, leg.path[-1, 1] - 0.1) < 0.05


def test_the_explorer_brings_the_car_home() -> None:
    explorer = Explorer(CAR, CONFIG)
    away = Pose2(1.2, 0.3, 2.0)
    for pose in (Pose2(), Pose2(0.6, 0.0, 0.5), away):
        for _ in range(3):
            explorer.look(scan(YARD, pose), SCANNER, pose, 0.0)
    explorer.begin(Task.HOME, Pose2())
    end = drive(explorer, YARD, away)
    assert (explorer.finished, explorer.found_way) == (True, True)
    assert end.distance_m(Pose2()) < 0.15


def test_legs_that_cannot_be_driven_are_given_up_in_the_end() -> None:
    explorer = Explorer(CAR, CONFIG)
    explorer.begin(Task.EXPLORE, Pose2())
    for _ in range(30):
        explorer.look(scan(SCREENED, Pose2()), SCANNER, Pose2(), 0.0)
        explorer.step(Pose2(), 0.0)
        if explorer.leg is not None:
            explorer.end(LegEnd(explorer.leg.number, arrived=False))
    assert explorer.finished


@pytest.mark.parametrize("closed", [False, True])
def test_a_loop_is_closed_where_the_robot_was_some_way_before(closed: bool) -> None:
    explorer = Explorer(CAR, CONFIG)
    turn = math.tau if closed else 3.0
    for k, angle in enumerate(np.linspace(0.0, turn, 80).tolist()):
        pose = Pose2(math.sin(angle), 1 - math.cos(angle), angle)
        explorer.look(np.full(BEAMS, np.nan, np.float32), SCANNER, pose, turn * k / 79)
    assert explorer.loop_closed is closed


def test_a_loop_stays_closed_after_its_places_are_forgotten() -> None:
    trail = Trail(TrailConfig(length=80))
    for k in range(200):
        angle = 0.035 * k
        trail.add(Pose2(math.sin(angle), 1 - math.cos(angle), angle), angle)
    assert not trail.loop_closed, "the places of 4 m before were forgotten"
    longer = Trail(TrailConfig(length=200))
    for k in range(600):
        angle = min(0.035 * k, 7.0)
        longer.add(Pose2(math.sin(angle) + 0.035 * max(0, k - 200), 1 - math.cos(angle), angle), 0.035 * k)
    assert longer.loop_closed


def test_the_way_back_along_the_trail_ends_where_it_has_a_gap() -> None:
    trail = Trail(TrailConfig(length=50))
    for x_m in (0.0, 1.0, *np.arange(2.0, 4.0, 0.031).tolist()):
        trail.add(Pose2(x_m, 0.0, 0.0), x_m)
    back = trail.back(Pose2(4.0, 0.0, 0.0), 0.5)
    assert 3.4 < back[-1, 0] < 3.55
    assert trail.back(Pose2(4.0, 0.0, 0.0), 9.0)[-1, 0] > 2.0
    assert np.all(np.diff(back[:, 0]) < 0)


@pytest.mark.parametrize("task", [Task.EXPLORE, Task.HOME])
def test_coarser_ways_lead_where_the_finest_do_not_get_to(task: Task) -> None:
    explorer = Explorer(CAR, replace(CONFIG, ways=WaysConfig(most_nodes=6000)))
    away = Pose2(1.6, 0.2, 0.0)
    for pose in (Pose2(-0.5, -0.6, 0.0), Pose2(0.3, 0.6, 0.0), Pose2(1.3, 0.7, -0.8), away):
        for k in range(8 if pose is not away else 2):
            explorer.look(scan(SCREENED, pose), SCANNER, pose, 0.1 * k)
    explorer.begin(task, Pose2(-0.5, -0.6, 0.0))
    drive(explorer, SCREENED, away)
    assert (explorer.finished, explorer.found_way) == (True, True)


def test_many_views_at_once_are_the_same_as_one_after_the_other() -> None:
    floor = seen_from(SCREENED, Pose2())
    poses = np.random.default_rng(1).uniform((-0.8, -0.8, -3.0), (1.8, 0.8, 3.0), (200, 3))
    together = floor.views_m2(poses, SCANNER, BEAMS)
    assert np.count_nonzero(together) > 50
    assert np.array_equal(together, [floor.views_m2(pose[None], SCANNER, BEAMS)[0] for pose in poses])


def test_room_along_a_path_is_room_in_the_whole() -> None:
    floor = seen_from(SCREENED, Pose2(), Pose2(0.3, 0.5, 0.0))
    for path in (np.array([[0.1, 0.0, 0.0], [0.4, 0.3, 0.3]]), np.array([[0.5, -0.3, 0.0], [0.7, -0.3, 0.0]])):
        whole = path_room_m(CAR, floor.room_for_body(Pose2(), 0.03), path)
        near = path_room_m(CAR, floor.room_along(path, 0.03), path)
        assert near == pytest.approx(whole)


def test_a_leg_is_planned_anew_when_something_stands_in_it() -> None:
    explorer = Explorer(CAR, CONFIG)
    away = Pose2(-0.6, 0.4, 0.0)
    for pose in (Pose2(), away):
        for k in range(3):
            explorer.look(scan(YARD, pose), SCANNER, pose, 0.1 * k)
    explorer.begin(Task.HOME, Pose2(1.3, 0.4, 0.0))
    explorer.step(away, 0.0)
    first = explorer.leg
    explorer.step(away, 0.0)
    assert first is not None
    assert explorer.leg is first
    x, y = first.path[len(first.path) // 2, :2].tolist()
    blocked = np.vstack((YARD, box(x, y - 0.1, x + 0.1, y + 0.1)))
    for k in range(4):
        explorer.look(scan(blocked, away), SCANNER, away, 0.1 * k)
    explorer.step(away, 0.0)
    assert explorer.leg is not first


def test_a_view_that_could_not_be_reached_is_left_for_another() -> None:
    explorer = Explorer(CAR, CONFIG)
    explorer.begin(Task.EXPLORE, Pose2())
    for _ in range(3):
        explorer.look(scan(SCREENED, Pose2()), SCANNER, Pose2(), 0.0)
    explorer.step(Pose2(), 0.0)
    first = explorer.leg
    assert first is not None
    explorer.end(LegEnd(first.number, arrived=False))
    explorer.step(Pose2(), 0.0)
    assert explorer.leg is not None
    ends = explorer.leg.path[-1] - first.path[-1]
    assert math.hypot(ends[0], ends[1]) >= 0.2 or abs(ends[2]) >= 0.6
