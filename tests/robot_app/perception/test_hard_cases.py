"""What a depth camera gives when something is wrong with the view."""

from __future__ import annotations

import numpy as np
import pytest

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import PerceptionConfig
from robot_app.perception.object_extractor import ObjectExtractor
from shared.geometry.camera import CameraMount
from shared.messages import ObjectNetwork

UNIT_M = 0.00025
NOWHERE = CameraMount(0.0, 100.0, 0.0)  # so high that no floor is in view


def extracted(world, depth_m: np.ndarray, mount: CameraMount = NOWHERE) -> ObjectNetwork:
    measured = np.where((depth_m >= 0.25) & (depth_m <= 9.0), depth_m, 0.0)
    extractor = ObjectExtractor(PerceptionConfig(), world.intrinsics, mount)
    return extractor.extract(DepthImage(0.0, np.round(measured / UNIT_M).astype(np.uint16), UNIT_M))


def noise(depth_m: np.ndarray, seed: int = 1) -> np.ndarray:
    return depth_m + np.random.default_rng(seed).normal(0.0, 1.0, depth_m.shape) * (0.001 + 0.001 * depth_m**2)


def box_before_a_wall() -> np.ndarray:
    depth_m = np.full((480, 640), 3.0)
    depth_m[150:330, 220:420] = 1.2
    return depth_m


def depths_m(network: ObjectNetwork) -> np.ndarray:
    return network.nodes_m[:, 0]


def corners_missed_m(world, network: ObjectNetwork) -> float:
    """How far the corner of the box that is missed most is from a node."""
    corners = [
        ((u - 320) / world.intrinsics.fx, (v - 240) / world.intrinsics.fy) for u in (220, 420) for v in (150, 330)
    ]
    nodes = np.stack((-network.nodes_m[:, 1], 100.0 - network.nodes_m[:, 2]), axis=1)
    return max(float(np.linalg.norm(nodes - 1.2 * np.array(corner), axis=1).min()) for corner in corners)


def test_a_box_before_a_wall_is_outlined_with_its_corners(world) -> None:
    network = extracted(world, noise(box_before_a_wall()))
    assert corners_missed_m(world, network) < 0.02
    assert len(network.edges) == len(network.nodes_m) == 4


def test_flying_pixels_round_a_box_change_little(world) -> None:
    depth_m = box_before_a_wall()
    rng = np.random.default_rng(3)
    for rows, columns in ((slice(148, 332), slice(217, 220)), (slice(148, 332), slice(420, 423))):
        shape = depth_m[rows, columns].shape
        depth_m[rows, columns] = rng.uniform(1.2, 3.0, shape)
    network = extracted(world, noise(depth_m))
    assert corners_missed_m(world, network) < 0.03
    assert np.abs(depths_m(network) - 1.2).max() < 0.06


def test_holes_all_over_change_little(world) -> None:
    depth_m = noise(box_before_a_wall())
    depth_m[np.random.default_rng(2).random(depth_m.shape) < 0.1] = 0.0
    network = extracted(world, depth_m)
    assert corners_missed_m(world, network) < 0.03
    assert len(network.nodes_m) <= 12


def test_the_ragged_shadow_of_the_l515_at_an_edge_changes_little(world) -> None:
    """Beside a near edge it measures nothing for up to a dozen pixels, with a ragged rim and single values in it."""
    depth_m, rng = noise(box_before_a_wall()), np.random.default_rng(4)
    for row in range(150, 330):
        depth_m[row, 420 : 420 + rng.integers(4, 13)] = 0.0
        depth_m[row, 420 - rng.integers(0, 3) : 420] = 0.0
    speckles = rng.random((180, 12)) < 0.04
    depth_m[150:330, 420:432][speckles] = rng.uniform(0.6, 3.0, int(speckles.sum()))
    network = extracted(world, depth_m)
    assert corners_missed_m(world, network) < 0.03
    assert np.abs(depths_m(network) - 1.2).max() < 0.1


@pytest.mark.parametrize(("limit_m", "height_m"), [(0.5, 0.15), (0.8, 0.25)])
def test_a_table_that_comes_too_near_has_no_edge_where_the_range_ends(world, limit_m: float, height_m: float) -> None:
    """That rim is as straight as an edge, and below it nothing is measured; what is farther behind is drawn."""
    slope_y = world.intrinsics.ray_slopes()[1].astype(np.float64)
    depth_m = noise(np.repeat(np.minimum(height_m / np.maximum(slope_y, 1e-6), 2.0)[:, None], 640, axis=1))
    network = extracted(world, np.where(depth_m < limit_m, 0.0, depth_m))
    assert len(network.nodes_m) > 0
    assert depths_m(network).min() > 1.8


def drawn_m(network: ObjectNetwork) -> float:
    """The length of all connections."""
    return float(np.linalg.norm(np.diff(network.nodes_m[network.edges], axis=1), axis=2).sum())


@pytest.mark.parametrize("seed", [5, 6])
def test_speckles_with_holes_between_them_give_hardly_a_line(world, seed: int) -> None:
    """As on black carpet: patches of a few pixels at two depths, and nothing between them."""
    patches = np.random.default_rng(seed).random((120, 160))
    depth_m = np.select([patches < 0.5, patches < 0.7], [0.0, 1.5], 1.9).repeat(4, axis=0).repeat(4, axis=1)
    network = extracted(world, depth_m)
    assert np.isfinite(network.nodes_m).all()
    assert drawn_m(network) < 2.0


@pytest.mark.parametrize("seed", [1, 2])
def test_a_noisy_band_beside_something_smooth_has_one_line_between_them(world, seed: int) -> None:
    """As the L515 gives what hardly reflects: patches of a few pixels that are some centimetres off."""
    patches_m = np.random.default_rng(seed).normal(0.0, 0.02, (30, 92)).repeat(7, axis=0).repeat(7, axis=1)
    depth_m = np.full((480, 640), 0.95)
    depth_m[:200] = np.linspace(0.75, 0.85, 200)[:, None] + patches_m[:200, :640]
    network = extracted(world, noise(depth_m))
    width_m = 0.85 * 640 / world.intrinsics.fx
    assert 0.5 * width_m < drawn_m(network) < 1.5 * width_m


@pytest.mark.parametrize("depth_m", [0.0, 0.3, 1.0, 20.0])
def test_an_empty_view_a_covered_lens_and_a_wall_that_fills_the_view_give_nothing(world, depth_m: float) -> None:
    network = extracted(world, np.full((480, 640), depth_m))
    assert len(network.nodes_m) == len(network.edges) == 0


def test_a_slanted_wall_with_noise_gives_nothing(world) -> None:
    slope_x, _ = world.intrinsics.ray_slopes()
    depth_m = np.broadcast_to(1.6 / (1.0 + 0.7 * slope_x.astype(np.float64)), (480, 640))
    assert len(extracted(world, noise(depth_m)).nodes_m) == 0


@pytest.mark.parametrize("hand_m", [0.0, 0.3])
@pytest.mark.parametrize("side", ["left", "below"])
def test_a_hand_before_half_of_the_lens_draws_nothing_on_what_is_behind_it(world, hand_m: float, side: str) -> None:
    """Fingers nearer than the camera measures: nothing, or values below its range."""
    depth_m = noise(np.full((480, 640), 2.0))
    columns, rows = np.meshgrid(np.arange(640), np.arange(480))
    depth_m[columns < 300 if side == "left" else rows > 240 + 60 * np.sin(columns / 60)] = hand_m
    assert len(extracted(world, depth_m).nodes_m) == 0


def test_a_hand_from_above_is_no_open_space_while_the_camera_says_something_of_it(world) -> None:
    depth_m = noise(np.full((480, 640), 2.0))
    columns, rows = np.meshgrid(np.arange(640), np.arange(480))
    depth_m[rows < 240 + 60 * np.sin(columns / 60)] = 0.3
    assert len(extracted(world, depth_m).nodes_m) == 0


def test_a_slot_two_cells_high_is_drawn_as_one_line(world) -> None:
    depth_m = np.full((480, 640), 3.0)
    depth_m[100:, 150:500] = 1.2
    depth_m[236:245, 200:450] = 3.0
    network = extracted(world, noise(depth_m))
    beside = np.abs(network.nodes_m[:, 2] - 100.0) < 0.03
    assert np.count_nonzero(beside & (np.abs(network.nodes_m[:, 1]) < 0.36)) == 2


def test_of_a_crowd_the_largest_outlines_are_kept(world) -> None:
    depth_m = np.full((480, 640), 3.0)
    for row in range(20, 460, 60):
        for column in range(20, 620, 60):
            depth_m[row : row + 36, column : column + 36] = 1.5
    depth_m[130:350, 200:440] = 3.0
    depth_m[150:330, 220:420] = 1.2
    network = extracted(world, noise(depth_m))
    most = PerceptionConfig().refine.most_nodes
    assert 0.8 * most < len(network.nodes_m) <= most
    assert corners_missed_m(world, network) < 0.03


def test_the_corner_of_a_room_is_drawn_once(world) -> None:
    slope_x, _ = world.intrinsics.ray_slopes()
    left, right = 2.0 / (1.0 - 1.0 * slope_x.astype(np.float64)), 2.0 / (1.0 + 1.0 * slope_x.astype(np.float64))
    network = extracted(world, noise(np.broadcast_to(np.minimum(left, right), (480, 640))))
    assert 1 <= len(network.edges) <= 3
    assert np.abs(network.nodes_m[:, 1]).max() < 0.03
