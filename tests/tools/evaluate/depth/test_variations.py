"""Labelled clouds that are changed in ways that must not matter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shared.geometry.camera import Intrinsics
from tools.evaluate.__main__ import main
from tools.evaluate.depth.variations import VARIATIONS, View, measure

LENS = Intrinsics(160, 120, 140.0, 140.0, 82.0, 57.0)


def box_on_nothing() -> View:
    """A labelled box at 1 m before a wall at 2 m."""
    depth, labels = np.full((120, 160), 2000, np.uint16), np.zeros((120, 160), np.int32)
    depth[48:80, 60:108], labels[48:80, 60:108] = 1000, 20
    return View(depth, 0.001, LENS, labels)


def seen_m(view: View) -> np.ndarray:
    """(N, 2): where the object's pixels are across the line of sight."""
    rows, columns = np.nonzero((view.labels > 0) & (view.depth > 0))
    z = view.depth[rows, columns] * view.unit_m
    slope_x, slope_y = view.lens.ray_slopes()
    return np.stack((slope_x[columns] * z, slope_y[rows] * z), axis=1)


def middle_of(points_m: np.ndarray) -> np.ndarray:
    return 0.5 * (points_m.min(axis=0) + points_m.max(axis=0))


@pytest.mark.parametrize("name", sorted(set(VARIATIONS) - {"mirrored", "lens 10 % shorter", "lens 10 % longer"}))
def test_a_variation_leaves_the_object_where_it_is(name: str) -> None:
    view = VARIATIONS[name](box_on_nothing(), np.random.default_rng(1))
    assert view.depth.shape == view.labels.shape == (view.lens.height, view.lens.width)
    before, after = seen_m(box_on_nothing()), seen_m(view)
    half_a_pixel_m = 0.5 / LENS.fx
    assert middle_of(after) == pytest.approx(middle_of(before), abs=0.3 * half_a_pixel_m)


def test_the_mirror_changes_sides() -> None:
    view = VARIATIONS["mirrored"](box_on_nothing(), np.random.default_rng(1))
    assert np.sort(seen_m(view)[:, 0]) == pytest.approx(-np.sort(seen_m(box_on_nothing())[:, 0])[::-1])


@pytest.mark.parametrize("name", ["as it is", "mirrored"])
def test_a_box_is_found_and_its_boundary_drawn(name: str) -> None:
    figures = measure(name, [box_on_nothing()])
    assert figures.object_recall == 1.0
    assert figures.boundary_precision is not None
    assert figures.boundary_precision > 0.9
    assert figures.boundary_recall is not None
    assert figures.boundary_recall > 0.9


def test_a_file_without_labels_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "depth.npy"
    np.save(path, np.full((48, 64), 1.5))
    monkeypatch.setattr("sys.argv", ["evaluate", "variations", str(path)])
    assert main() == 2
    assert "depth.npy" in capsys.readouterr().err
