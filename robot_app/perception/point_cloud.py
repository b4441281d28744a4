"""From a depth image to the points on the edges of things (paper 1, eqs 4-11).

There are three kinds of edges: where a near surface hides a farther one (eqs 7-9 on the near side alone, to the pixel),
where something stands on the floor, and creases, where two surfaces meet or one stands a little before the
other; eqs 7-9 see few of those.
What is not known is no edge: an object that the image border cuts has none there, and a hole counts as seen through
only if something farther appears on its other side, or if it is open space, that is reaches down from the upper border
to something that was measured. So neither a hand before the lens nor a wall nearer than the camera's range makes edges
on what is behind it, and a wall's top against nothing is one.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from robot_app.perception import _kernels as kernels
from robot_app.perception.config import EdgeConfig
from robot_app.perception.curves import _kernels as curves
from robot_app.perception.curves.tracer import CurveTracer
from shared.geometry.camera import Intrinsics

_NEAR_LIMIT = 1.2  # surfaces within this many times the least range may end where the range does


class Mount(Protocol):
    """Where the camera sits; `CameraMount` is one."""

    def robot_from_optical(self) -> NDArray[np.float64]:
        """(4, 4): optical frame to robot frame."""
        ...


class EdgeCloud:
    """The edge points of the newest image, optical frame, in buffers that are used again for the next.

    `points`: how many points of the decimated image are in range. `edge_m`: (E, 3) float32 of which the first
    `edges` count, no more than `max_edges`; `edge_at`: (R, C) int32, the edge point in each cell of `stride` pixels,
    -1 for none.
    `sample_m`: the sample nodes A of step 1, of which the first `samples` count; `sample_weight`, `sample_curve`
    and what it knows of the curves are those of `CurveTracer`.
    `up`: (4,), a point's height over the floor is `up[:3] @ point + up[3]`. `lens`: fx, fy, cx, cy.
    """

    def __init__(self, config: EdgeConfig, intrinsics: Intrinsics, mount: Mount) -> None:
        self._config = config
        self._shape = (intrinsics.height, intrinsics.width)
        self.stride = config.stride_px
        rows, columns = intrinsics.height // self.stride, intrinsics.width // self.stride
        if rows < 4 or columns < 4:
            raise ValueError(f"a {intrinsics.width} x {intrinsics.height} image is too small for stride {self.stride}")
        self.slope_x, self.slope_y = intrinsics.ray_slopes()
        self.lens = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy], np.float64)
        self.up = np.array(mount.robot_from_optical()[2], np.float64)
        self.cell_width = self.stride / min(intrinsics.fx, intrinsics.fy)
        self.z = np.zeros((rows, columns), np.float32)
        self.edge_at = np.full((rows, columns), -1, np.int32)
        self.edge_m = np.zeros((min(config.max_edges, rows * columns), 3), np.float32)
        self._tracer = tracer = CurveTracer(config, rows, columns)
        self.sample_m, self.sample_weight = tracer.sample_m, tracer.sample_weight
        self.sample_curve = tracer.sample_curve
        self.curve_group, self.curve_extent_m, self.curve_detail = tracer.group, tracer.extent_m, tracer.detail
        self.curve_closed = tracer.closed
        self._inverse = np.zeros((rows, columns), np.float32)
        self._bend, self._shift, self._edge_q = np.zeros((3, 2, rows, columns), np.float32)
        self._pair = np.zeros(rows * columns, np.float32)
        self._floor, self._marks = np.zeros((2, rows, columns), np.uint8)
        self._worth = np.zeros(rows * columns, np.uint8)
        tile = kernels.TILE_CELLS
        self._crowd = np.zeros((rows // tile + 3, columns // tile + 3), np.int32)
        self._open_rows = np.zeros(columns, np.int32)
        self.points = self.edges = self.samples = 0

    def update(self, image: DepthImage) -> None:
        """Take the edges and samples from `image`."""
        if image.depth.shape != self._shape:
            raise ValueError(f"the depth image is {image.depth.shape}, the intrinsics say {self._shape}")
        # Numba compiles anew for a read-only or a strided array: whatever comes, the kernels see one type.
        depth = np.ascontiguousarray(image.depth, np.uint16).view()
        depth.setflags(write=False)
        self._decimate(depth, float(image.unit_m))
        self._find_edges(depth, float(image.unit_m))
        self._choose_samples()

    def _decimate(self, depth: NDArray[np.uint16], unit_m: float) -> None:
        config = self._config
        self.points = kernels.decimate(depth, unit_m, self.stride, config.range_min_m, config.range_max_m, self.z)
        near_depth = config.range_min_m / unit_m
        kernels.find_open(depth, self.z, self.stride, near_depth, config.min_open_cells, self._open_rows)
        kernels.mark_floor(
            self.z,
            self.slope_x,
            self.slope_y,
            self.stride,
            self.cell_width,
            self.up,
            config.floor_height_m,
            config.floor_slope,
            config.depth_noise,
            self._floor,
            self._inverse,
        )

    def _find_edges(self, depth: NDArray[np.uint16], unit_m: float) -> None:
        self.edge_at.fill(-1)
        self.edges = 0
        self._find_occluding(depth, unit_m)
        self._find_contact()
        for vertical in (0, 1):
            self._measure_bends(vertical)
        for vertical in (0, 1):
            self._find_bends(vertical)
        kernels.count_crowd(self.edge_at, self._crowd)
        self._hand_to_smooth()

    def _hand_to_smooth(self) -> None:
        config = self._config
        kernels.hand_to_smooth(
            self._inverse,
            self.slope_x,
            self.slope_y,
            self.stride,
            self.cell_width,
            self.lens,
            config.depth_noise,
            self._crowd,
            config.speckle_share,
            self.edge_m,
            self.edge_at,
            self.edges,
        )

    def _find_occluding(self, depth: NDArray[np.uint16], unit_m: float) -> None:
        config = self._config
        columns = self.z.shape[1]
        kernels.mark_steps(self.z.reshape(-1), columns, self.cell_width, config.alpha, self._marks.reshape(-1))
        self.edges = kernels.find_occluding(
            depth,
            unit_m,
            self.z,
            self.slope_x,
            self.slope_y,
            self.stride,
            self.cell_width,
            self._open_rows,
            self._floor,
            _NEAR_LIMIT * config.range_min_m,
            config.alpha,
            config.max_step_widths,
            config.max_hole_cells,
            self._marks,
            self.edge_m,
            self.edge_at,
            self.edges,
        )

    def _find_contact(self) -> None:
        config, first = self._config, self.edges
        self.edges = kernels.find_contact(
            self.z,
            self.slope_x,
            self.slope_y,
            self.stride,
            self.cell_width,
            self.lens,
            self.up,
            config.floor_height_m,
            config.floor_slope,
            self._floor,
            config.max_hole_cells,
            self.edge_m,
            self.edge_at,
            self.edges,
        )
        self._tracer.drop_short(self.edge_m, self.edge_at, first, self.edges, self.lens, self.stride, self.cell_width)

    def _measure_bends(self, vertical: int) -> None:
        config = self._config
        curves.measure_bends(
            self._inverse,
            self._inverse.reshape(-1),
            self.slope_y if vertical else self.slope_x,
            self.stride,
            self.stride / self.lens[vertical],
            vertical,
            config.crease_angle_rad,
            math.pi if vertical else config.narrow_crease_angle_rad,
            config.min_step_m,
            config.depth_noise,
            self._pair,
            self._marks.reshape(-1),
            self._worth,
            self._bend[vertical],
            self._shift[vertical],
            self._edge_q[vertical],
        )

    def _find_bends(self, vertical: int) -> None:
        self.edges = curves.find_bends(
            self.slope_x,
            self.slope_y,
            self.stride,
            vertical,
            self._bend[vertical],
            self._bend[1 - vertical],
            self._shift[vertical],
            self._edge_q[vertical],
            self.edge_m,
            self.edge_at,
            self.edges,
        )

    def _choose_samples(self) -> None:
        tracer = self._tracer
        tracer.update(self.edge_m, self.edge_at, self._crowd, self._inverse, self.lens, self.stride, self.cell_width)
        self.samples = tracer.samples
