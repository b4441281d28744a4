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
