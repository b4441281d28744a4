from __future__ import annotations

from pathlib import Path

import numpy as np

from station_gui.export.tum import write_tum


def test_a_trajectory_is_a_line_per_pose_with_its_heading_as_a_quaternion(tmp_path: Path) -> None:
    write_tum(tmp_path / "t.tum", np.array([[1.5, 0.1, -0.2, 0.0], [2.0, 0.3, 0.4, np.pi / 2]]))
    rows = np.loadtxt(tmp_path / "t.tum")
    np.testing.assert_allclose(rows[0], [1.5, 0.1, -0.2, 0, 0, 0, 0, 1])
    np.testing.assert_allclose(rows[1], [2.0, 0.3, 0.4, 0, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-9)
