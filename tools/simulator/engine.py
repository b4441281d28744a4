"""The only place that imports MuJoCo.

MuJoCo's Python package would bring in PyOpenGL and fix it to one platform for the whole process; the simulator
renders through its own EGL context instead (see `egl`).
"""

from __future__ import annotations

import os

os.environ["MUJOCO_GL"] = "disable"  # MuJoCo reads it when it is imported

import mujoco

__all__ = ["mujoco"]
