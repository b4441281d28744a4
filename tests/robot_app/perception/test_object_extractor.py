"""The whole extraction, on boxes whose edges are known."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from robot_app.drivers.base import DepthImage
from robot_app.perception import _kernels as edge_kernels
from robot_app.perception.completion import _kernels as completion_kernels
from robot_app.perception.config import EdgeConfig, LearningConfig, PerceptionConfig, RefineConfig
from robot_app.perception.curves import _kernels as crease_kernels
from robot_app.perception.curves.sampling import _kernels as sampling_kernels
from robot_app.perception.curves.tracing import _kernels as tracing_kernels
from robot_app.perception.learners.simplified import _kernels as growth_kernels
from robot_app.perception.network import _kernels as network_kernels
from robot_app.perception.object_extractor import ObjectExtractor, clusters
from robot_app.perception.refinement import _kernels as refinement_kernels
from shared.geometry.camera import CameraMount, Intrinsics
from shared.messages import ObjectNetwork

UNIT_M = 0.00025
KINECT = Path(__file__).resolve().parents[3] / ".." / "shared" / "data" / "depth" / "kinect_sequence"


def extractor_of(world, config: PerceptionConfig | None = None) -> ObjectExtractor:
    return ObjectExtractor(config or PerceptionConfig(), world.intrinsics, world.mount)


def lengths_m(network: ObjectNetwork) -> np.ndarray:
    return np.linalg.norm(network.nodes_m[network.edges[:, 0]] - network.nodes_m[network.edges[:, 1]], axis=1)


def along(network: ObjectNetwork) -> np.ndarray:
    """(N, 3): points every 2 cm along the connections."""
    pieces = [
        np.linspace(network.nodes_m[a], network.nodes_m[b], 2 + int(length / 0.02))
        for (a, b), length in zip(network.edges, lengths_m(network), strict=True)
    ]
    return np.concatenate(pieces).astype(np.float64)


def distance_m(points_m: np.ndarray, segments_m: np.ndarray) -> np.ndarray:
    """(N,): how far each point is from the nearest of the segments (S, 2, 3)."""
    a, way = segments_m[:, 0], segments_m[:, 1] - segments_m[:, 0]
    t = np.clip(np.einsum("nsk,sk->ns", points_m[:, None] - a, way) / (way**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(points_m[:, None] - a - t[..., None] * way, axis=2).min(axis=1)


def room_edges_m(room) -> np.ndarray:
    return np.concatenate([box.edges_m() for box in room])


def test_nodes_lie_on_the_edges_of_the_boxes(world, room, room_image) -> None:
    network = extractor_of(world).extract(room_image)
    off_m = distance_m(network.nodes_m.astype(np.float64), room_edges_m(room))
    assert len(network.nodes_m) > 30
    assert np.median(off_m) < 0.01
    assert np.quantile(off_m, 0.9) < 0.05


def test_connections_follow_the_edges_and_do_not_cross_free_air(world, room, room_image) -> None:
    network = extractor_of(world).extract(room_image)
    off_m = distance_m(along(network), room_edges_m(room))
    assert np.quantile(off_m, 0.9) < 0.04
    assert off_m.max() < 0.15


def test_the_outline_of_a_box_is_drawn_whole(world, room) -> None:
    box = room[0]
    network = extractor_of(world).extract(world.image([box], np.random.default_rng(1)))
    x, (y0, y1), z1 = box.low_m[0], (box.low_m[1], box.high_m[1]), box.high_m[2]
    outline = np.array([[x, y0, 0], [x, y0, z1], [x, y1, z1], [x, y1, 0], [x, y0, 0]])
    wanted = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(outline)])
    found = network.nodes_m[network.edges].astype(np.float64)
    assert np.mean(distance_m(wanted, found) < 0.03) > 0.9
    assert clusters(network).max() <= 1  # the inner edge may stand by itself


def test_the_floor_makes_no_nodes(world) -> None:
    network = extractor_of(world).extract(world.image([], np.random.default_rng(1)))
    assert len(network.nodes_m) == 0


def test_nodes_on_the_floor_are_only_where_something_stands(world, room, room_image) -> None:
    network = extractor_of(world).extract(room_image)
    low = network.nodes_m[network.nodes_m[:, 2] < 0.05].astype(np.float64)
    assert len(low) > 3
    assert distance_m(low, room_edges_m(room)).max() < 0.06


@pytest.mark.parametrize("pitch_rad", [-0.03, -0.012, 0.012, 0.03])
def test_the_floor_makes_no_nodes_while_the_car_pitches(world, pitch_rad: float) -> None:
    extractor = ObjectExtractor(PerceptionConfig(), world.intrinsics, CameraMount(0.28, 0.17, pitch_rad))
    network = extractor.extract(world.image([], np.random.default_rng(1)))
    assert len(network.nodes_m) == 0


@pytest.mark.parametrize("pitch_rad", [-0.012, -0.009])
def test_the_foot_of_a_front_is_drawn_while_the_floor_seems_to_rise(world, room, pitch_rad: float) -> None:
    """At 3 m by up to 3.6 cm, more than what belongs to the floor near by."""
    front = replace(room[0], low_m=(3.0, -1.0, 0.0), high_m=(3.2, 1.0, 1.0))
    mount = CameraMount(0.28, 0.17, pitch_rad)
    extractor = ObjectExtractor(PerceptionConfig(), world.intrinsics, mount)
    network = extractor.extract(world.image([front], np.random.default_rng(1)))
    true_from_pitched = world.mount.robot_from_optical() @ np.linalg.inv(mount.robot_from_optical())
    nodes_m = network.nodes_m @ true_from_pitched[:3, :3].T + true_from_pitched[:3, 3]
    foot_m = np.linspace((3.0, -1.0, 0.0), (3.0, 1.0, 0.0), 40)
    assert np.mean(distance_m(foot_m, nodes_m[network.edges]) < 0.04) > 0.9


def test_no_node_has_more_than_two_connections_after_learning(world, room_image) -> None:
    extractor = extractor_of(world)
    extractor.find_edges(room_image)
    extractor.learn()
    degrees = extractor.network.linked[: extractor.network.nodes, : extractor.network.nodes].sum(axis=1)
    assert degrees.max() == 2
    assert degrees.min() == 1


def test_no_node_is_left_alone(world, room_image) -> None:
    network = extractor_of(world).extract(room_image)
    assert set(network.edges.ravel().tolist()) == set(range(len(network.nodes_m)))


def test_the_network_is_small_and_its_nodes_keep_their_distance(world, room_image) -> None:
    network = extractor_of(world).extract(room_image)
    assert len(network.nodes_m) <= 100
    assert lengths_m(network).min() >= 0.0247  # γ₃ over the greatest detail


@pytest.mark.parametrize("value", [0, 400, 4000, 65535])
def test_a_blocked_an_empty_and_a_full_view_give_an_empty_network(world, value: int) -> None:
    """Nothing measured; a hand at 0.1 m; a wall of one depth; beyond the range."""
    extractor = ObjectExtractor(PerceptionConfig(), world.intrinsics, CameraMount(0.0, 100.0, 0.0))
    network = extractor.extract(DepthImage(0.0, np.full((480, 640), value, np.uint16), UNIT_M))
    assert len(network.nodes_m) == 0
    assert len(network.edges) == 0


def test_noise_without_a_scene_stays_within_the_bounds(world) -> None:
    rng = np.random.default_rng(1)
    config = PerceptionConfig(learning=LearningConfig(max_nodes=60))
    for block in (1, 8, 32):
        coarse = rng.integers(0, 36000, (480 // block, 640 // block))
        depth = coarse.repeat(block, axis=0).repeat(block, axis=1).astype(np.uint16)
        network = extractor_of(world, config).extract(DepthImage(0.0, depth, UNIT_M))
        assert len(network.nodes_m) <= 60
        assert np.isfinite(network.nodes_m).all()


def test_two_extractors_give_the_same_network_bit_for_bit(world, room_image) -> None:
    first, second = extractor_of(world).extract(room_image), extractor_of(world).extract(room_image)
    assert first.nodes_m.tobytes() == second.nodes_m.tobytes()
    assert first.edges.tobytes() == second.edges.tobytes()


def test_what_was_seen_before_leaves_no_trace(world, room, room_image) -> None:
    used = extractor_of(world)
    used.extract(world.image(room[1:], np.random.default_rng(2), flying=True))
    assert used.extract(room_image).nodes_m.tobytes() == extractor_of(world).extract(room_image).nodes_m.tobytes()


def test_a_still_scene_gives_nearly_the_same_network_from_frame_to_frame(world, room) -> None:
    extractor = extractor_of(world)
    frames = [extractor.extract(world.image(room, np.random.default_rng(k), flying=True)) for k in range(3)]
    repeated = [
        np.mean(distance_m(along(a), b.nodes_m[b.edges].astype(np.float64)) < 0.03)
        for a in frames
        for b in frames
        if a is not b
    ]
    counts = [int(clusters(frame).max()) + 1 for frame in frames]
    assert np.mean(repeated) > 0.8
    assert max(counts) - min(counts) <= 3


def test_the_image_is_not_written_to(world, room) -> None:
    image = world.image(room)
    image.depth.setflags(write=False)
    assert len(extractor_of(world).extract(image).nodes_m) > 0


def test_another_size_of_image_works_too(room, room_image, world) -> None:
    half = DepthImage(0.0, np.ascontiguousarray(room_image.depth[::2, ::2]), UNIT_M)
    intrinsics = Intrinsics(320, 240, world.intrinsics.fx / 2, world.intrinsics.fy / 2, 160, 120)
    config = PerceptionConfig(edges=EdgeConfig(stride_px=2))
    extractor = ObjectExtractor(config, intrinsics, world.mount)
    off_m = distance_m(extractor.extract(half).nodes_m.astype(np.float64), room_edges_m(room))
    assert len(off_m) > 30
    assert np.median(off_m) < 0.015


def test_warming_up_leaves_an_extractor_that_works_as_before(world, room_image) -> None:
    warm = extractor_of(world)
    warm.warm_up()
    assert warm.extract(room_image).nodes_m.tobytes() == extractor_of(world).extract(room_image).nodes_m.tobytes()


def test_nothing_is_compiled_after_warming_up(world, room_image) -> None:
    extractor = extractor_of(world)
    extractor.warm_up()
    before = [len(kernel.signatures) for kernel in all_kernels()]
    writable = room_image.depth.copy()
    strided = np.zeros((480, 1280), np.uint16)
    strided[:, ::2] = room_image.depth
    for depth in (writable, room_image.depth, strided[:, ::2]):
        extractor.extract(DepthImage(0.0, depth, UNIT_M))
    assert [len(kernel.signatures) for kernel in all_kernels()] == before


def all_kernels() -> list:
    modules = (
        edge_kernels,
        crease_kernels,
        tracing_kernels,
        sampling_kernels,
        growth_kernels,
        completion_kernels,
        network_kernels,
        refinement_kernels,
    )
    return [item for module in modules for item in vars(module).values() if hasattr(item, "signatures")]


def test_clusters_are_the_connected_components() -> None:
    edges = np.array([[0, 3], [3, 5], [1, 2], [2, 4]], np.uint16)
    assert clusters(ObjectNetwork(np.zeros((6, 3), np.float32), edges)).tolist() == [0, 1, 1, 0, 1, 0]


def test_impossible_parameters_are_refused() -> None:
    for make in (
        lambda: EdgeConfig(stride_px=0),
        lambda: EdgeConfig(range_min_m=10.0),
        lambda: LearningConfig(max_nodes=1),
        lambda: LearningConfig(min_length_m=(0.4, 0.1, 0.1)),
        lambda: RefineConfig(connection_step_m=0.0),
    ):
        with pytest.raises(ValueError, match="must be"):
            make()


@pytest.mark.skipif(not KINECT.is_dir(), reason="the recorded depth frames (../shared/data/depth) are not here")
def test_recorded_frames_give_small_networks_without_stray_nodes() -> None:
    intrinsics = Intrinsics(640, 480, 585.0, 585.0, 320.0, 240.0)
    extractor = ObjectExtractor(PerceptionConfig(), intrinsics, CameraMount(0.0, 100.0, 0.0))
    for path in sorted(KINECT.glob("*.depth.png"))[::25]:
        with Image.open(path) as picture:
            depth = np.asarray(picture).astype(np.uint16)
        network = extractor.extract(DepthImage(0.0, depth, 0.001))
        assert 20 < len(network.nodes_m) < 180, path.name
        assert lengths_m(network).min() >= 0.0247
