from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tools.simulator import _kernels
from tools.simulator._kernels import inverse_depth, noisy_depth
from tools.simulator.depth_camera import DepthRenderer, DepthSensor, ExposureClock, camera_intrinsics
from tools.simulator.scenario import CameraParameters, Item, Room, Scenario, Start
from tools.simulator.world import World

MakeRoom = Callable[..., Scenario]


def rendered(scenario: Scenario) -> NDArray[np.float64]:
    """(480, 640) true depths in m, 0 for none."""
    world = World(scenario, seed=1)
    renderer = DepthRenderer(world.model, scenario.camera)
    inverse = np.empty((480, 640), np.float32)
    renderer.render(world.camera_state(), inverse)
    renderer.close()
    renderer.close()
    return np.divide(1.0, inverse, out=np.zeros(inverse.shape), where=inverse > 0)


def test_a_wall_ahead_has_the_same_depth_everywhere(room: MakeRoom) -> None:
    depth = rendered(room())
    wall = depth[200:260]  # neither floor nor the room beyond the wall's top
    assert wall[:, 240:400] == pytest.approx(3.95 - 1.28, abs=2e-3)


def test_the_floor_follows_from_height_and_row(room: MakeRoom) -> None:
    depth = rendered(room())
    rows = np.arange(400, 480)
    slope = camera_intrinsics(CameraParameters()).ray_slopes()[1][rows]
    assert depth[rows, 320] == pytest.approx(0.17 / slope, rel=3e-3)


def test_the_left_of_the_image_is_the_left_of_the_robot(room: MakeRoom) -> None:
    box = Item("box", (2.5, 2.6), (0.4, 0.4, 0.4))
    depth = rendered(room(box))
    assert depth[230, 80] == pytest.approx(2.3 - 1.28, abs=5e-3)
    assert depth[230, 500] > 1.5


def test_beyond_the_far_plane_there_is_nothing(room: MakeRoom) -> None:
    hall = replace(room(start=Start((1.0, 2.0))), room=Room(length_x_m=30.0))
    assert rendered(hall)[230, 320] == 0.0


def plane(depth_m: float) -> NDArray[np.float32]:
    return np.full((480, 640), 1 / depth_m, np.float32)


@pytest.mark.parametrize(("depth_m", "sigma_m"), [(1.0, 0.0025), (5.0, 0.009)])
def test_noise_grows_with_range(depth_m: float, sigma_m: float) -> None:
    image = DepthSensor(CameraParameters(), seed=3).image(plane(depth_m), 0, 0.0)
    measured = image.depth[image.depth > 0] * image.unit_m
    assert measured.mean() == pytest.approx(depth_m, abs=2e-4)
    assert measured.std() == pytest.approx(sigma_m, rel=0.05)


def test_noise_of_neighbours_is_a_little_correlated() -> None:
    parameters = CameraParameters(dropout=0.0)
    depth = DepthSensor(parameters, seed=3).image(plane(1.0), 0, 0.0).depth.astype(np.float64)
    correlation = np.corrcoef(depth[:, :-1].ravel(), depth[:, 1:].ravel())[0, 1]
    assert 0.15 < correlation < 0.5


def test_too_near_too_far_and_nothing_give_zero() -> None:
    sensor = DepthSensor(CameraParameters(), seed=3)
    assert not sensor.image(plane(0.45), 0, 0.0).depth.any()
    assert not sensor.image(plane(9.5), 0, 0.0).depth.any()
    assert not sensor.image(np.zeros((480, 640), np.float32), 0, 0.0).depth.any()


def test_edges_drop_out_and_fly_but_surfaces_stay() -> None:
    inverse = plane(1.0)
    inverse[:, 320:] = 1 / 3.0
    depth = DepthSensor(CameraParameters(dropout=0.0), seed=3).image(inverse, 0, 0.0).depth * 0.00025
    at_edge, inside = depth[1:-1, 319:321], depth[1:-1, 20:300]
    assert (at_edge == 0).mean() == pytest.approx(0.35, abs=0.06)
    assert ((at_edge > 1.1) & (at_edge < 2.9)).mean() == pytest.approx(0.25, abs=0.07)
    assert (np.abs(inside - 1.0) < 0.02).all()


def test_a_plane_seen_at_a_slant_is_no_edge_but_fades_when_it_is_far() -> None:
    parameters = CameraParameters(dropout=0.0)
    slopes = camera_intrinsics(parameters).ray_slopes()[1]
    floor = np.repeat((np.maximum(slopes, 0) / 0.17)[:, None], 640, axis=1).astype(np.float32)
    depth = DepthSensor(parameters, seed=3).image(floor, 0, 0.0).depth
    assert (depth[380:410] > 0).all()  # between 0.5 and 0.7 m
    assert (depth[245:255] == 0).all()  # beyond 3 m, under less than 4 degrees


def test_a_frame_has_its_own_noise_whoever_read_the_frames_before_it() -> None:
    first, second = DepthSensor(CameraParameters(), seed=3), DepthSensor(CameraParameters(), seed=3)
    first.image(plane(2.0), 0, 0.0)
    assert np.array_equal(first.image(plane(2.0), 7, 0.0).depth, second.image(plane(2.0), 7, 0.0).depth)
    assert not np.array_equal(first.image(plane(2.0), 8, 0.0).depth, second.image(plane(2.0), 7, 0.0).depth)


def test_the_kernels_agree_with_plain_python(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    buffer = rng.random((6, 8), np.float32)
    buffer[0, 0] = 0.0
    inverse = np.empty_like(buffer)
    inverse_depth(buffer, 0.02, 12.0, inverse)
    twin = np.where(buffer > 0, 1 / (12 * 0.02 / (12 - 0.02) / (buffer + 0.02 / (12 - 0.02))), 0)[::-1]
    assert inverse == pytest.approx(twin, rel=1e-5)
    inverse = (0.2 + rng.random((6, 8))).astype(np.float32)
    compiled = small_noisy_image(noisy_depth, inverse)
    # Compiled, the hash returns a Python integer, on which plain Python would not wrap around.
    monkeypatch.setattr(_kernels, "_mixed", _kernels._mixed.py_func)
    with np.errstate(over="ignore"):
        plain = small_noisy_image(noisy_depth.py_func, inverse)
    assert np.abs(compiled - plain).max() <= 1


def small_noisy_image(kernel: Callable[..., None], inverse: NDArray[np.float32]) -> NDArray[np.int64]:
    out, above = np.empty((6, 8), np.uint16), np.empty(8, np.float32)
    columns, rows = np.linspace(-0.5, 0.5, 8, dtype=np.float32), np.linspace(-0.4, 0.4, 6, dtype=np.float32)
    kernel(
        inverse, columns, rows, np.uint64(99), 0.00025, 0.5, 9.0, 0.0025, 0.0016, 0.35, 0.1, 0.03, 0.3, 0.3, 0.02,
        above, out,
    )  # fmt: skip
    return out.astype(np.int64)


def test_frames_are_marked_at_30_hz(room: MakeRoom) -> None:
    world = World(room(), seed=1)
    clock = ExposureClock(world)
    world.add_observer(clock)
    stamps = []
    for _ in range(500):
        world.advance_to(world.time_s + 0.002)
        if (exposure := clock.exposures.take(0.0)) is not None:
            stamps.append(exposure.stamp_s)
    assert len(stamps) == 30
    assert math.isclose(float(np.mean(np.diff(stamps))), 1 / 30, abs_tol=1e-3)
