from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from station_gui.mapping.objects.dbscan import _kernels
from station_gui.mapping.objects.dbscan.dbscan import Density, cluster_lines, nearest_clusters

STEP_2 = Density(math.radians(10.0), 0.10, 2, 1.0)

Lines = NDArray[np.float64]


def algorithm_1(lines: Lines, objects: NDArray[np.int64], density: Density) -> set[frozenset[int]]:
    """As the paper writes it, without haste; the clusters, without noise."""

    def distance(a: Lines, b: Lines) -> float:
        short, long = sorted((a, b), key=lambda line: float(np.hypot(*(line[1] - line[0]))))
        points = short[0], short.mean(axis=0), short[1]
        return min(_kernels.point_from_line.py_func(p[0], p[1], long, density.offset_weight) for p in points)

    def turn(a: Lines, b: Lines) -> float:
        angles = [math.atan2(*(line[1] - line[0])[::-1]) for line in (a, b)]
        away = abs(angles[0] - angles[1]) % math.pi
        return min(away, math.pi - away)

    left, found = set(range(len(lines))), set()
    while left:
        cluster, core = [min(left)], 0
        left.remove(cluster[0])
        while core < len(cluster):
            at = lines[cluster[core]]
            near = [
                j for j in sorted(left)
                if turn(lines[j], at) <= density.turn_rad and distance(lines[j], at) <= density.reach_m
            ]  # fmt: skip
            cluster += near
            left -= set(near)
            core += 1
        if objects[cluster].sum() >= density.min_objects:
            found.add(frozenset(cluster))
    return found


def random_lines(count: int, rng: np.random.Generator) -> Lines:
    start = rng.uniform(0, 2, (count, 2))
    angle = rng.choice([0.0, math.pi / 2, 0.5], count) + rng.normal(0, 0.05, count)
    length = rng.uniform(0.05, 0.5, count)[:, None]
    return np.stack((start, start + length * np.column_stack((np.cos(angle), np.sin(angle)))), axis=1)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("weight", [1.0, 4.0])
def test_clusters_are_those_of_the_paper(seed: int, weight: float) -> None:
    rng = np.random.default_rng(seed)
    lines, objects = random_lines(60, rng), rng.integers(1, 3, 60)
    density = Density(STEP_2.turn_rad, STEP_2.reach_m, 2, weight)
    labels = cluster_lines(lines, objects, density)
    found = {frozenset(np.flatnonzero(labels == k).tolist()) for k in range(int(labels.max()) + 1)}
    assert found == algorithm_1(lines, objects, density)


def test_lines_that_cross_at_an_angle_are_two_clusters() -> None:
    lines = np.array([[[0, 0], [1, 0]], [[0.5, 0], [0.5, 1]], [[1.05, 0], [2, 0]], [[0.5, 1.05], [0.5, 2]]], float)
    assert cluster_lines(lines, np.ones(4, np.int64), STEP_2).tolist() == [0, 1, 0, 1]


def test_a_line_alone_is_noise() -> None:
    lines = np.array([[[0, 0], [1, 0]], [[5, 5], [6, 5]]], float)
    assert cluster_lines(lines, np.array([1, 2]), STEP_2).tolist() == [-1, 0]


def test_a_point_belongs_to_the_nearest_line_within_reach() -> None:
    lines = np.array([[[0, 0], [1, 0]], [[0, 1], [1, 1]], [[0, 0.02], [1, 0.02]]], float)
    points = np.array([[0.5, 0.05], [0.5, 0.94], [0.5, 0.5], [1.05, 0.0]])
    assert nearest_clusters(points, lines, np.array([0, 1, -1]), 0.10).tolist() == [0, 1, -1, 0]


def test_nothing_has_no_clusters() -> None:
    assert len(cluster_lines(np.zeros((0, 2, 2)), np.zeros(0, np.int64), STEP_2)) == 0


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_lines_are_those_that_a_look_at_all_of_them_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, starts = rng.uniform(0, 3, (200, 2)), rng.uniform(0, 3, (30, 1, 2))
    lines = starts + np.concatenate((np.zeros((30, 1, 2)), rng.uniform(-0.6, 0.6, (30, 1, 2))), axis=1)
    labels = rng.integers(-1, 8, 30)
    away = np.array([[_kernels.point_from_line.py_func(x, y, line, 1.0) for line in lines] for x, y in points])
    away[:, labels < 0] = np.inf
    expected = np.where(away.min(axis=1) <= 0.1, labels[away.argmin(axis=1)], -1)
    np.testing.assert_array_equal(nearest_clusters(points, lines, labels, 0.1), expected)
