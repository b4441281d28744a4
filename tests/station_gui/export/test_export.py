"""Each format is opened by the library that reads it; Nav2's by a reader written to its documented rules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from shared.geometry.se2 import Pose2
from station_gui.export.bundle import export_map
from station_gui.export.files import ExportError, write_whole
from station_gui.export.gltf import write_glb
from station_gui.export.model3d import Model3d, make_model
from station_gui.export.nav2 import write_nav2
from station_gui.export.ply import write_ply
from station_gui.mapping.snapshot import NO_OBJECTS, GridMap, MapSnapshot, ObjectKind, ObjectMap, Panels

FREE, UNKNOWN, OCCUPIED = 0.1, 0.5, 0.9


def _grid() -> GridMap:
    """30 x 20 cells of 5 cm: a free room with a wall at the left and an unknown corner at the top right."""
    probability = np.full((20, 30), FREE, np.float32)
    probability[:, :2] = OCCUPIED
    probability[15:, 20:] = UNKNOWN
    return GridMap(probability, (-0.7, 0.25), 0.05)


def _box() -> ObjectMap:
    """A wall and the front of a small box, with one edge each."""
    wall = [[-0.6, 0.3, 0.0], [-0.6, 1.2, 0.0], [-0.6, 1.2, 1.0], [-0.6, 0.3, 1.0]]
    front = [[0.2, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, 0.5, 0.4], [0.2, 0.5, 0.4]]
    kinds = np.array([ObjectKind.LARGE, ObjectKind.SMALL], np.uint8)
    clusters = np.array([0, 1], np.int32)
    edges = np.array([[wall[1], wall[2]], [front[1], front[2]]], np.float32)
    return ObjectMap(edges, kinds, clusters, Panels(np.array([wall, front], np.float32), kinds, clusters))


def _snapshot(objects: ObjectMap) -> MapSnapshot:
    trajectory = np.array([[1.0, 0.0, 0.5, 0.0], [2.0, 0.2, 0.6, 0.3], [3.0, 0.4, 0.8, 0.6]])
    closures = np.zeros((0, 2), np.int32)
    pose = Pose2(0.4, 0.8, 0.6)
    return MapSnapshot(1, 3.0, pose, Pose2(), _grid(), objects, trajectory, closures, 3, 0.001, 0.001)


def _read_nav2(yaml_path: Path) -> tuple[np.ndarray, tuple[float, float], float]:
    """As nav2_map_server reads a map in mode trinary: (rows, columns) of -1, 0, 100, row 0 the lowest y."""
    settings = dict(line.split(": ", 1) for line in yaml_path.read_text("utf-8").splitlines())
    assert settings["mode"] == "trinary"
    magic, size, maximum, pixels = (yaml_path.parent / settings["image"]).read_bytes().split(b"\n", 3)
    assert (magic, maximum) == (b"P5", b"255")
    columns, rows = (int(k) for k in size.split())
    values = np.frombuffer(pixels, np.uint8).reshape(rows, columns) / 255.0
    occupancy = values if int(settings["negate"]) else 1.0 - values
    cells = np.full(occupancy.shape, -1)
    cells[occupancy > float(settings["occupied_thresh"])] = 100
    cells[occupancy < float(settings["free_thresh"])] = 0
    x, y, yaw = (float(k) for k in settings["origin"].strip("[]").split(","))
    assert yaw == 0.0
    return cells[::-1], (x, y), float(settings["resolution"])


def test_nav2_reads_back_what_is_free_occupied_and_unknown_and_where_it_is(tmp_path: Path) -> None:
    grid = _grid()
    write_nav2(grid, tmp_path / "map.yaml")
    cells, origin_m, cell_m = _read_nav2(tmp_path / "map.yaml")
    expected = np.select([grid.probability == np.float32(FREE), grid.probability == np.float32(OCCUPIED)], [0, 100], -1)
    np.testing.assert_array_equal(cells, expected)
    assert origin_m == pytest.approx(grid.origin_m)
    assert cell_m == pytest.approx(grid.cell_m)


def test_pillow_opens_the_picture_of_nav2(tmp_path: Path) -> None:
    write_nav2(_grid(), tmp_path / "map.yaml")
    with Image.open(tmp_path / "map.pgm") as picture:
        assert picture.size == (30, 20)


def _bounds(scene: trimesh.Scene, name: str) -> np.ndarray:
    return np.asarray(scene.geometry[name].bounds)


def test_trimesh_reads_the_surfaces_of_the_ply_with_their_places_and_colours(tmp_path: Path) -> None:
    model = make_model(_snapshot(_box()))
    write_ply(model, tmp_path / "map.ply")
    mesh = trimesh.load(tmp_path / "map.ply", process=False)
    assert len(mesh.faces) == sum(len(piece.faces) for piece in model.triangles)
    free_m2 = np.count_nonzero(_grid().probability == np.float32(FREE)) * 0.05**2
    assert mesh.area == pytest.approx(free_m2 + 0.9 * 1.0 + 0.3 * 0.4, rel=1e-4)
    np.testing.assert_allclose(mesh.bounds, [[-0.6, 0.25, 0.0], [0.8, 1.25, 1.0]], atol=1e-5)
    colours = {tuple(c[:3]) for c in mesh.visual.vertex_colors.tolist()}
    assert {piece.colour for piece in model.triangles} <= colours


def test_the_ply_holds_the_edges_as_edges(tmp_path: Path) -> None:
    write_ply(make_model(_snapshot(_box())), tmp_path / "map.ply")
    header = (tmp_path / "map.ply").read_bytes().split(b"end_header\n")[0].decode()
    assert "element edge 4\n" in header  # one of the wall, one of the box, two of the way


def test_trimesh_reads_every_piece_of_the_glb_with_y_up(tmp_path: Path) -> None:
    write_glb(make_model(_snapshot(_box())), tmp_path / "map.glb")
    scene = trimesh.load(tmp_path / "map.glb", process=False)
    assert set(scene.geometry) == {
        "floor", "objects large", "objects small", "edges large", "edges small", "way of the robot"
    }  # fmt: skip
    np.testing.assert_allclose(_bounds(scene, "objects small"), [[0.2, 0.5, 0.0], [0.5, 0.5, 0.4]], atol=1e-6)
    whole = np.asarray(scene.bounds)  # x stays, z goes up along y, y goes to -z
    np.testing.assert_allclose(whole, [[-0.6, 0.0, -1.25], [0.8, 1.0, -0.25]], atol=1e-5)
    red = scene.geometry["objects large"].visual.material.baseColorFactor
    assert red[0] > 2 * red[1]


def test_a_map_without_depth_still_exports(tmp_path: Path) -> None:
    written = export_map(_snapshot(NO_OBJECTS), tmp_path / "out")
    names = {"map.yaml", "map.pgm", "map.png", "map.ply", "map.glb", "trajectory.tum"}
    assert {path.name for path in written} == names == {path.name for path in (tmp_path / "out").iterdir()}
    assert len(trimesh.load(tmp_path / "out" / "map.ply", process=False).faces) > 0
    with Image.open(tmp_path / "out" / "map.png") as picture:
        assert min(picture.size) > 100
    rows = np.loadtxt(tmp_path / "out" / "trajectory.tum")
    np.testing.assert_allclose(rows[:, 1:3], [[0.0, 0.5], [0.2, 0.6], [0.4, 0.8]])
    np.testing.assert_allclose(2 * np.arctan2(rows[:, 6], rows[:, 7]), [0.0, 0.3, 0.6], atol=1e-6)


def test_an_empty_model_is_a_file_that_can_be_read(tmp_path: Path) -> None:
    write_ply(Model3d((), ()), tmp_path / "m.ply")
    write_glb(Model3d((), ()), tmp_path / "m.glb")
    assert (tmp_path / "m.ply").read_bytes().startswith(b"ply\n")
    assert trimesh.load(tmp_path / "m.glb").is_empty


def test_the_floor_is_whole_whatever_the_cells(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    probability = np.where(generator.random((40, 50)) < 0.6, FREE, OCCUPIED).astype(np.float32)
    snapshot = _snapshot(NO_OBJECTS)
    grid = GridMap(probability, (0.0, 0.0), 0.02)
    made = make_model(MapSnapshot(1, 0.0, Pose2(), Pose2(), grid, NO_OBJECTS, snapshot.trajectory[:0],
                                  snapshot.closures, 0, 0.0, 0.0))  # fmt: skip
    write_ply(made, tmp_path / "m.ply")
    area = trimesh.load(tmp_path / "m.ply", process=False).area
    assert area == pytest.approx(np.count_nonzero(probability == np.float32(FREE)) * 4e-4, rel=1e-4)
    assert not made.lines


def test_a_folder_that_cannot_be_written_is_named_and_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(ExportError, match=r"taken.*choose another folder"):
        write_whole(tmp_path / "taken" / "map.ply", b"x")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_an_older_file_gives_way_whole(tmp_path: Path) -> None:
    path = tmp_path / "map.ply"
    write_whole(path, b"old and long")
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]
