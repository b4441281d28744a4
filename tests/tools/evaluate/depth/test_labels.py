"""How a network is compared with labels."""

from __future__ import annotations

import numpy as np
import pytest

from robot_app.drivers.base import DepthImage
from shared.geometry.camera import Intrinsics
from tools.evaluate.depth.labels import (
    compare_with_labels,
    object_of,
    occluding_boundary,
    sample_connections,
)

LENS = Intrinsics(160, 120, 100.0, 100.0, 80.0, 60.0)
ROWS, COLUMNS = slice(40, 80), slice(60, 100)


def box_before_a_wall() -> tuple[np.ndarray, np.ndarray]:
    """Depth (m) and labels: a box of 40 x 40 cm at 1 m, a wall at 2 m."""
    depth_m = np.full((120, 160), 2.0)
    labels = np.ones((120, 160), np.int32)
    depth_m[ROWS, COLUMNS], labels[ROWS, COLUMNS] = 1.0, 20
    return depth_m, labels


def boundary_of(depth_m: np.ndarray, labels: np.ndarray) -> np.ndarray:
    return occluding_boundary(depth_m, object_of(labels, depth_m > 0))


def outline_px() -> set[tuple[int, int]]:
    inside = np.zeros((120, 160), bool)
    inside[ROWS, COLUMNS] = True
    inside[41:79, 61:99] = False
    return set(map(tuple, np.argwhere(inside).tolist()))


def pixels(mask: np.ndarray) -> set[tuple[int, int]]:
    return set(map(tuple, np.argwhere(mask).tolist()))


def test_the_boundary_is_the_rim_of_what_hides_something() -> None:
    assert pixels(boundary_of(*box_before_a_wall())) == outline_px()


def test_the_boundary_lies_at_the_near_side_of_a_shadow() -> None:
    depth_m, labels = box_before_a_wall()
    depth_m[:, 100:112] = 0.0
    assert pixels(boundary_of(depth_m, labels)) == outline_px()


def test_where_an_object_touches_what_it_stands_on_is_no_boundary() -> None:
    depth_m, labels = box_before_a_wall()
    depth_m[80:, :] = 1.005
    assert not boundary_of(depth_m, labels)[79, 61:99].any()


def test_a_hole_in_an_object_is_no_boundary() -> None:
    depth_m, labels = box_before_a_wall()
    depth_m[55:65, 75:85] = 0.0
    assert pixels(boundary_of(depth_m, labels)) == outline_px()


def test_a_deeper_object_behind_has_no_boundary_where_it_is_hidden() -> None:
    depth_m, labels = box_before_a_wall()
    depth_m[50:70, 100:130], labels[50:70, 100:130] = 1.5, 35
    mask = boundary_of(depth_m, labels)
    assert not mask[51:69, 100].any()
    assert mask[51:69, 129].all()


def test_background_that_was_cropped_away_is_hidden_and_the_border_of_the_image_hides_nothing() -> None:
    depth_m, labels = box_before_a_wall()
    depth_m[labels < 20] = 0.0
    assert pixels(boundary_of(depth_m, labels)) == outline_px()
    assert pixels(boundary_of(depth_m[ROWS, COLUMNS], labels[ROWS, COLUMNS])) == set()


def test_connections_are_sampled_every_centimetre() -> None:
    points = sample_connections(np.array([[0, 0, 1], [0.1, 0, 1.0]]), np.array([[0, 1]]))
    np.testing.assert_allclose(points[:, 0], np.linspace(0, 0.1, 11), atol=1e-9)


def square_m(half_m: float, z_m: float = 1.0) -> np.ndarray:
    return half_m * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) + [0, 0, z_m]


RING = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])


def compared(nodes_m: np.ndarray, connections: np.ndarray, clusters: list[int]) -> tuple[float | None, ...]:
    depth_m, labels = box_before_a_wall()
    image = DepthImage(0.0, (depth_m * 1000).astype(np.uint16), 0.001)
    found = compare_with_labels(image, labels, LENS, nodes_m, connections, np.array(clusters, np.int32))
    return found.object_recall, found.boundary_precision, found.boundary_recall


def test_a_true_outline_is_perfect() -> None:
    assert compared(square_m(0.2), RING, [0, 0, 0, 0]) == (1.0, 1.0, 1.0)


def test_an_outline_of_nothing_is_worth_nothing() -> None:
    assert compared(square_m(0.6, 1.5), RING, [0, 0, 0, 0]) == (0.0, 0.0, 0.0)


def test_half_an_outline_is_half_the_recall() -> None:
    recall, precision, boundary_recall = compared(square_m(0.2)[:3], RING[:2], [0, 0, 0])
    assert (recall, precision) == (1.0, 1.0)
    assert boundary_recall == pytest.approx(0.5, abs=0.08)


def test_a_cluster_of_which_less_than_60_percent_is_the_object_does_not_find_it() -> None:
    nodes_m = np.concatenate((square_m(0.2), square_m(0.8)))
    assert compared(nodes_m, np.concatenate((RING, RING + 4)), [0, 0, 0, 0, 1, 1, 1, 1])[0] == 1.0
    assert compared(nodes_m, np.concatenate((RING, RING + 4)), [0] * 8)[0] == 0.0


def test_no_network_finds_nothing_and_has_no_precision() -> None:
    assert compared(np.zeros((0, 3)), np.zeros((0, 2), np.int64), []) == (0.0, None, 0.0)
