"""Panels as meshes: which are solid, which see-through, and how many at most."""

import numpy as np
import pytest

from station_gui.mapping.snapshot import ObjectKind, Panels
from station_gui.views import map3d_surfaces
from station_gui.views.map3d_surfaces import flat_mesh, measured_mesh


def upright(x0, y0, x1, y1, height):
    return [[x0, y0, 0], [x1, y1, 0], [x1, y1, height], [x0, y0, height]]


@pytest.fixture
def panels():
    corners = [
        upright(0, 0, 1, 0, 1.0),
        upright(0, 0, 0, 1, 0.3),
        upright(2, 0, 2, 3, 0.5),
        upright(0, 1, 1, 1, np.nan),
    ]
    kinds = [ObjectKind.LARGE, ObjectKind.SMALL, ObjectKind.FLAT, ObjectKind.LARGE]
    return Panels(np.array(corners, np.float32), np.array(kinds, np.uint8), np.array([0, 1, -1, 2], np.int32))


def test_measured_panels_are_solid_and_in_the_papers_colours(panels):
    mesh = measured_mesh(panels)
    assert len(mesh.faces) == 4
    assert (mesh.colours[:, 3] == 1.0).all()
    red, blue = mesh.colours[0], mesh.colours[2]
    assert red[0] > 1.5 * red[2]
    assert blue[2] > 1.3 * blue[0]
    triangles = mesh.vertices_m[mesh.faces].astype(np.float64)
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    assert areas == pytest.approx([0.5, 0.5, 0.15, 0.15])


def test_walls_of_the_2d_map_can_be_seen_through(panels):
    mesh = flat_mesh(panels)
    assert len(mesh.faces) == 2
    assert (mesh.colours[:, 3] < 0.6).all()


def test_of_a_very_large_map_the_largest_panels_are_shown(panels, monkeypatch):
    monkeypatch.setattr(map3d_surfaces, "MOST_PANELS", 1)
    mesh = measured_mesh(panels)
    assert len(mesh.faces) == 2
    assert mesh.vertices_m[:, 2].max() == 1.0


def test_a_map_without_panels_has_no_mesh():
    assert len(measured_mesh(Panels()).faces) == 0
    assert len(flat_mesh(Panels()).faces) == 0


def test_the_triangles_of_a_panel_cover_it(panels):
    triangles = panels.triangles_m()
    assert triangles.shape == (8, 3, 3)
    np.testing.assert_array_equal(triangles[1], panels.corners_m[0][[0, 2, 3]])
