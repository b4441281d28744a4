"""Trajectories as text, the way the TUM benchmark has them: time x y z qx qy qz qw, a pose a line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from station_gui.export.files import write_whole


def write_tum(path: Path, trajectory: NDArray[np.float64]) -> None:
    """`trajectory`: (N, 4) stamp_s, x_m, y_m, theta_rad; the plane is z = 0. Raises `ExportError`."""
    lines = (
        f"{t:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(theta / 2):.9f} {math.cos(theta / 2):.9f}\n"
        for t, x, y, theta in trajectory.tolist()
    )
    write_whole(path, "".join(lines).encode())
