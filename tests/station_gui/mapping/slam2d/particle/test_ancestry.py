from __future__ import annotations

import numpy as np

from station_gui.mapping.slam2d.particle.ancestry import Ancestry


def test_a_path_goes_through_the_parents_and_dead_branches_are_forgotten() -> None:
    rng = np.random.default_rng(7)
    tree, ends = Ancestry(), np.full(8, -1)
    paths: list[list[float]] = [[] for _ in range(8)]
    for k in range(3000):
        if k % 3 == 0:
            parents = np.sort(rng.integers(0, 8, 8))
            ends, paths = ends[parents], [list(paths[p]) for p in parents]
        poses = rng.normal(size=(8, 3))
        ends = tree.extend(ends, poses)
        for path, pose in zip(paths, poses, strict=True):
            path.append(float(pose[0]))
    for end, path in zip(ends.tolist(), paths, strict=True):
        np.testing.assert_array_equal(tree.path(end)[:, 0], path)
    assert len(tree) <= 8192  # of 24 000 that were made


def test_bending_moves_every_path_and_leaves_the_motions_as_they_were_made() -> None:
    tree, ends = Ancestry(), np.full(2, -1)
    for k in range(5):
        ends = tree.extend(ends if k != 3 else ends[[1, 1]], np.array([[k, 0.0, 0.0], [k, 1.0, 0.0]]))
    before, motions = tree.path(int(ends[0])), tree.motions(int(ends[0]))
    corrections = np.column_stack((np.zeros(5), np.arange(5.0), np.zeros(5)))

    tree.bend(corrections)

    np.testing.assert_allclose(tree.path(int(ends[0])), before + corrections)
    np.testing.assert_array_equal(tree.motions(int(ends[0])), motions)
    np.testing.assert_array_equal(before[:, 1], [1.0, 1.0, 1.0, 0.0, 0.0])
    assert tree.name_of_ancestor(int(ends[0]), 2) == tree.name_of_ancestor(int(ends[1]), 2)
    assert tree.name_of_ancestor(int(ends[0]), 3) != tree.name_of_ancestor(int(ends[1]), 3)
