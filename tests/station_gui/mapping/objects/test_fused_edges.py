from __future__ import annotations

import math

import numpy as np
import pytest

from shared.messages import ObjectNetwork
from station_gui.mapping.objects.config import CameraView, FusionConfig
from station_gui.mapping.objects.fusing import _kernels
from station_gui.mapping.objects.pieces import pieces_of

CAMERA = CameraView()


def extreme(values: list[float], cut: list[int] | None = None, need: int = 2) -> float:
    flags = np.array(cut or [0] * len(values), np.float64)
    return float(_kernels.supported_extreme(np.array(values), np.ones(len(values)), flags, len(values), 0.05, need))


def test_an_end_is_where_two_views_agree() -> None:
    assert extreme([0.30, 0.70, 0.72, 1.40]) == pytest.approx(0.71)


def test_an_edge_that_the_image_cuts_goes_at_least_so_far() -> None:
    assert extreme([0.30, 0.31, 0.64, 0.65], cut=[0, 0, 1, 1]) == pytest.approx(0.64)
    assert extreme([0.70, 0.71, 0.64, 0.65], cut=[0, 0, 1, 1]) == pytest.approx(0.705)


def test_a_single_view_is_all_there_is() -> None:
    assert extreme([0.4], need=1) == 0.4
    assert extreme([0.4], cut=[1], need=1) == 0.4


def test_an_upright_edge_is_the_mean_of_its_views_without_the_stray_one() -> None:
    rng = np.random.default_rng(1)
    pieces = np.zeros((12, 2, 3))
    pieces[:, :, :2] = np.array([1.0, 2.0]) + rng.normal(0, 0.004, (12, 1, 2))
    pieces[:, 1, 2] = 0.5 + rng.normal(0, 0.004, 12)
    pieces[11, :, 0] += 0.06
    out = np.zeros((2, 3))
    _kernels.fuse_upright(pieces, np.ones(12), np.zeros((12, 2)), 12, 0.035, 0.05, np.zeros((3, 12)), out)
    np.testing.assert_allclose(out[:, :2].mean(axis=0), pieces[:11, :, :2].mean(axis=(0, 1)), atol=1e-9)
    assert out[1, 2] == pytest.approx(0.5, abs=0.01)


def test_a_level_edge_is_the_line_through_its_views_as_numpy_finds_it() -> None:
    rng = np.random.default_rng(2)
    at = np.sort(rng.uniform(0, 1, (20, 2)), axis=1)
    at[:2] = (0.0, 1.0)
    pieces = np.stack((2 * at, at, np.full((20, 2), 0.7)), axis=2) + rng.normal(0, 0.003, (20, 2, 3))
    out = np.zeros((2, 3))
    _kernels.fuse_level(pieces, np.ones(20), np.zeros((20, 2)), 20, 0.1, np.zeros((3, 20)), out)
    weight = np.repeat(np.hypot(*(pieces[:, 1] - pieces[:, 0])[:, :2].T), 2)
    points = pieces.reshape(-1, 3)
    middle = np.average(points, axis=0, weights=weight)
    away = (points - middle)[:, :2]
    axis = np.linalg.eigh((weight[:, None] * away).T @ away)[1][:, 1]
    off = (out[:, :2] - middle[:2]) @ np.array([-axis[1], axis[0]])
    np.testing.assert_allclose(off, 0, atol=1e-9)
    assert out[:, 2] == pytest.approx(middle[2])
    np.testing.assert_allclose(sorted(out[:, 0].tolist()), [0.0, 2.0], atol=0.12)


@pytest.mark.parametrize(
    ("point", "seen"),
    [
        ((1.28, 0.0, 0.17), True),
        ((0.60, 0.0, 0.17), False),  # too near
        ((6.0, 0.0, 0.17), False),
        ((1.28, 0.75, 0.17), False),
        ((1.28, 0.55, 0.17), True),
        ((1.28, 0.0, 0.65), False),
        ((-1.0, 0.0, 0.17), False),
    ],
)
def test_the_camera_sees_what_is_before_it(point: tuple[float, float, float], seen: bool) -> None:
    assert _kernels.in_view(*point, CAMERA.as_array()) == seen


def test_pieces_are_upright_or_level_and_cut_at_the_images_border() -> None:
    top = 0.17 + math.tan(CAMERA.vertical_rad / 2) * 0.72
    nodes = np.array([[1.0, 0, 0], [1.0, 0, top], [1.0, 0.3, 0.3], [1.0, -0.2, 0.0]], np.float32)
    network = ObjectNetwork(nodes, np.array([[1, 0], [1, 2], [0, 3]], np.uint16))
    pieces = pieces_of(network, FusionConfig(), CAMERA)
    assert pieces.upright.tolist() == [1, 0]
    assert pieces.ends_m[0, 0, 2] < pieces.ends_m[0, 1, 2]
    assert pieces.cut[0].tolist() == [0.0, 1.0]


def test_what_is_not_finite_is_no_piece() -> None:
    network = ObjectNetwork(np.array([[1, 0, 0], [1, 0, np.nan]], np.float32), np.array([[0, 1]], np.uint16))
    assert len(pieces_of(network, FusionConfig(), CAMERA).ends_m) == 0


def test_from_afar_an_upright_edge_is_no_evidence_and_a_level_one_less_than_from_near() -> None:
    nodes = np.array([[2.7, 0, 0], [2.7, 0, 0.5], [2.9, 0, 0], [2.9, 0, 0.5], [2.9, 0.6, 0.5], [1, 0, 0.5]], np.float32)
    network = ObjectNetwork(nodes, np.array([[0, 1], [2, 3], [3, 4], [1, 5]], np.uint16))
    config = FusionConfig(far_level=0.4)
    pieces = pieces_of(network, config, CAMERA)
    assert pieces.upright.tolist() == [1, 1, 0, 0]
    assert pieces.evidence.tolist() == [1.0, 0.0, 0.4, 1.0]
