"""Threads edge points onto curves and chooses the sample nodes A along them (end of step 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_app.perception.config import EdgeConfig
from robot_app.perception.curves.sampling import _kernels as sampling
from robot_app.perception.curves.tracing import _kernels as kernels


class CurveTracer:
    """The curves of the newest image; its memory is allocated when it is made.

    `sample_m`: (S, 3) the sample nodes, of which the first `samples` count; `sample_weight`: how much each is
    preferred; `sample_curve`: the curve that each lies on. For each curve, `group`: the same number when they touch;
    `extent_m`: its size; `detail`: by how much shorter than those of table 3 its connections may be.
    """

    def __init__(self, config: EdgeConfig, rows: int, columns: int) -> None:
        self._config = config
        cells = rows * columns
        self.sample_m = np.zeros((config.max_samples, 3), np.float32)
        self.sample_weight = np.zeros(config.max_samples, np.float32)
        self.sample_curve = np.zeros(config.max_samples, np.int32)
        self.group = np.zeros(cells, np.int32)
        self._point_m = np.zeros((cells, 3), np.float32)
        self._point_uv = np.zeros((cells, 2), np.float32)
        self._point_at = np.full((rows, columns), -1, np.int32)
        self._wanted = np.zeros((cells, 2), np.int32)
        self._beside = np.zeros((cells, 2), np.int32)
        self._curve = np.zeros(cells, np.int32)
        self._order = np.zeros(cells, np.int32)
        self._start = np.zeros(cells + 1, np.int32)
        self.closed = np.zeros(cells, np.uint8)
        self._path_m, self._smooth_m, self._corner_m = np.zeros((3, cells, 3), np.float32)
        self._score = np.zeros(cells, np.float32)
        self._arc_m = np.zeros(cells, np.float32)
        self.extent_m = np.zeros(cells, np.float32)
        self.detail = np.ones(cells, np.float32)
        self._box_m = np.zeros((cells, 6), np.float32)
        self._near = np.zeros(24, np.int32)
        self._way = np.zeros((24, 5), np.float32)
        self._ends = np.zeros(cells, np.int32)
        self._tail = np.zeros(cells, np.int32)
        self.samples = self.curves = self.points = 0

    def update(
        self,
        edge_m: NDArray[np.float32],
        edge_at: NDArray[np.int32],
        crowd: NDArray[np.int32],
        inverse: NDArray[np.float32],
        lens: NDArray[np.float64],
        stride: int,
        cell_width: float,
    ) -> None:
        """Take curves and samples from the edge points; arguments as in `EdgeCloud`; `crowd`: of `count_crowd`,
        `inverse`: of `mark_floor`."""
        self._trace(edge_m, edge_at, lens, stride, cell_width)
        self._choose_samples(crowd, inverse, cell_width)

    def drop_short(
        self,
        edge_m: NDArray[np.float32],
        edge_at: NDArray[np.int32],
        first: int,
        end: int,
        lens: NDArray[np.float64],
        stride: int,
        cell_width: float,
    ) -> None:
        """Forget pieces of contact with the floor that are too short, which are the edge points `first` to `end`."""
        limit_m = self._config.min_contact_m
        kernels.drop_short(edge_m, edge_at, first, end, lens, stride, cell_width, limit_m, self._curve, self._box_m)

    def _trace(
        self,
        edge_m: NDArray[np.float32],
        edge_at: NDArray[np.int32],
        lens: NDArray[np.float64],
        stride: int,
        cell_width: float,
    ) -> None:
        points = kernels.list_points(
            edge_m, edge_at, lens, stride, cell_width, self._point_m, self._point_uv, self._point_at
        )
        image = self._point_m, self._point_uv, self._point_at, cell_width
        kernels.choose_neighbours(*image, self._near, self._way, self._wanted)
        kernels.keep_mutual(points, self._wanted, self._beside)
        for _ in range(2):  # a piece between two others is joined to one of them at a time
            ends = kernels.list_ends(self._beside, points, self._ends, self._tail)
            kernels.join_ends(*image, self._ends, ends, self._tail, self._wanted, self._beside)
        self.points = points
        self.curves = kernels.trace(points, self._beside, self._curve, self._order, self._start, self.closed)

    def _choose_samples(self, crowd: NDArray[np.int32], inverse: NDArray[np.float32], cell_width: float) -> None:
        config, curves = self._config, self.curves
        paths = self._order, self._start, self.closed
        sampling.lay_out(self._point_m, *paths, curves, cell_width, self._path_m)
        sampling.smooth(
            self._path_m,
            self._start,
            self.closed,
            curves,
            config.corner_arm_points,
            self._smooth_m,
            self._corner_m,
            self._score,
            self._arc_m,
        )
        sampling.measure(
            self._smooth_m,
            self._score,
            self._order,
            self._point_m,
            self._point_uv,
            self._start,
            curves,
            crowd,
            config.crowd_share,
            config.min_curve_m,
            config.min_curve_cells,
            config.max_roughness,
            inverse,
            config.depth_noise,
            config.max_looseness,
            config.loose_range_m,
            config.max_raggedness,
            cell_width,
            config.detail_curve_m,
            config.max_detail,
            self.extent_m,
            self.detail,
        )
        kernels.group_curves(
            self._point_m,
            self._point_uv,
            self._point_at,
            *paths,
            self._curve,
            curves,
            self.extent_m,
            cell_width,
            self.group,
        )
        self.samples = sampling.choose_samples(
            self._corner_m,
            self._smooth_m,
            self._score,
            self._arc_m,
            self._start,
            self.closed,
            curves,
            self.extent_m,
            self.detail,
            config.full_curve_m,
            config.corner_gain,
            config.sample_spacing_m,
            config.max_samples,
            self.sample_m,
            self.sample_weight,
            self.sample_curve,
        )
