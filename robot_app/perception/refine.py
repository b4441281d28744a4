"""Post-processing of the network, in the paper's order (paper 1, sections 3.2.1-3.2.5)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robot_app.perception.completion import _kernels as completion
from robot_app.perception.config import RefineConfig
from robot_app.perception.learner import Network
from robot_app.perception.point_cloud import EdgeCloud
from robot_app.perception.refinement import _kernels as kernels

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]
_Evidence = tuple[_F64, int, float, float, _F32, _I32]


class Refiner:
    """Turns what was learned into outlines worth sending; its memory is allocated when it is made."""

    def __init__(self, config: RefineConfig, max_nodes: int, max_samples: int) -> None:
        self._config = config
        self._beside = np.zeros((max_nodes, kernels.MOST), np.int32)
        self._degree = np.zeros(max_nodes, np.int32)
        self._angle = np.zeros(max_nodes, np.float32)
        self._ends, self._member = np.zeros((2, max_nodes), np.int32)
        self._start = np.zeros(max_nodes + 1, np.int32)
        self._covered = np.zeros(max_samples, np.uint8)
        self._pile = np.zeros(completion.DEEPEST + 1, np.int32)

    def find_curves(self, network: Network, cloud: EdgeCloud) -> None:
        """For what a learner made that does not ask for curves: nodes belong to the curve of the nearest sample."""
        kernels.find_curves(
            cloud.sample_m, cloud.sample_curve, cloud.samples, network.node_m, network.nodes, network.node_curve
        )

    def refine(self, network: Network, cloud: EdgeCloud) -> None:
        """Work on `network`, which was learned from `cloud`."""
        kernels.list_neighbours(network.linked, network.nodes, self._beside, self._degree)
        self._complete(network, cloud)
        self._remove_ground(network, cloud)
        self._reduce_straight(network, cloud, keep_near_open_m=self._config.loop_reach_m)
        self._close_loops(network, cloud)
        self._contract_short(network, cloud)
        self._reduce_straight(network, cloud, keep_near_open_m=0.0)
        self._remove_noise(network, cloud)
        kernels.remove_unsupported(*self._graph(network), *self._evidence(cloud))
        self._keep_important(network, cloud)
        kernels.link_neighbours(self._beside, self._degree, network.nodes, network.linked)
        network.drop_isolated()

    def _graph(self, network: Network) -> tuple[_F32, _I32, _I32, int]:
        return network.node_m, self._beside, self._degree, network.nodes

    def _evidence(self, cloud: EdgeCloud, step_m: float | None = None) -> _Evidence:
        """What tells whether a connection lies on edges (section 3.2.5, eqs 31-33).

        Eq 31 as printed is 1 for a connection that has *no* point near its middle t, and 0 is removed: the opposite of
        what the text says it is for. Here a connection goes when it has no point of D near it, with D the edge points,
        for surface is everywhere; "any point of D" is read as "there is one", and within q on each axis, as eq 31 has
        it, but across the line of sight no farther than 2.5 cells. The middle alone (eq 33) lets a connection cross
        from one object to the next where a third one lies in between: points every `step_m` along it are asked.
        """
        config = self._config
        step_m = config.connection_step_m if step_m is None else step_m
        return cloud.lens, cloud.stride, config.connection_reach_m, step_m, cloud.edge_m, cloud.edge_at

    def _complete(self, network: Network, cloud: EdgeCloud) -> None:
        """Beyond the paper: nodes keep the lengths of table 3 apart, and a connection that does not lie on edges is not
        made, so stretches of a curve may be left out: they are drawn with as many nodes as they need."""
        config = self._config
        network.nodes = completion.complete(
            cloud.sample_m,
            cloud.sample_curve,
            cloud.samples,
            cloud.curve_closed,
            cloud.curve_detail,
            config.follow_cells * cloud.cell_width,
            config.min_connection_m,
            *self._evidence(cloud),
            network.node_m,
            network.node_curve,
            network.node_weight,
            self._beside,
            self._degree,
            network.nodes,
            self._ends,
            self._member,
            self._covered,
            self._pile,
        )

    def _remove_ground(self, network: Network, cloud: EdgeCloud) -> None:
        """Section 3.2.1, eqs 24 and 25.

        The text marks nodes *without* a neighbour above or below as ground, while eq 24 read with "for all i" would
        mark every node: the points of D are read as "there is one". Horizontally the distance is within g_x = g_z in
        the plane of the floor, not on each axis, for the robot's axes mean nothing to the objects; and only what is
        low can be ground, for a table top is level too.
        """
        config = self._config
        kernels.remove_ground(
            *self._graph(network),
            cloud.z,
            cloud.slope_x,
            cloud.slope_y,
            cloud.lens,
            cloud.stride,
            cloud.up,
            config.ground_reach_m,
            config.ground_rise_m,
            config.ground_band_m,
        )

    def _reduce_straight(self, network: Network, cloud: EdgeCloud, keep_near_open_m: float) -> None:
        """Section 3.2.2, eq 26.

        The first time the nodes within `keep_near_open_m` of an open end stay, for closing loops is what they may be
        needed for; what was kept in vain goes the second time.
        """
        config = self._config
        kernels.reduce_straight(
            *self._graph(network),
            config.straight_angle_rad,
            config.straight_offset_m,
            keep_near_open_m,
            *self._evidence(cloud),
            self._angle,
            self._ends,
        )

    def _close_loops(self, network: Network, cloud: EdgeCloud) -> None:
        """Section 3.2.3, eqs 27 and 28.

        Eq 27 does not say in what unit θ is: degrees, for with η₁ and η₂ of table 3 then 95° weigh as much as a metre.
        Nor does it say which nodes v may be chosen: those of curves that touch, within `loop_reach_m`, at more than 45°
        to the connection that is there, and with edge points all along the way, or all objects would become one.
        """
        config = self._config
        kernels.close_loops(
            network.node_m,
            network.node_curve,
            cloud.curve_group,
            cloud.curve_detail,
            self._beside,
            self._degree,
            network.nodes,
            math.degrees(config.eta_angle_per_deg),
            config.eta_distance_per_m,
            config.loop_reach_m,
            *self._evidence(cloud, config.loop_step_m),
        )

    def _contract_short(self, network: Network, cloud: EdgeCloud) -> None:
        """Closing loops connects nodes however near they are; table 4 has none nearer than γ₃."""
        kernels.contract_short(
            network.node_m,
            network.node_curve,
            cloud.curve_detail,
            self._beside,
            self._degree,
            network.nodes,
            self._config.min_connection_m,
            *self._evidence(cloud),
        )

    def _remove_noise(self, network: Network, cloud: EdgeCloud) -> None:
        """Section 3.2.4, eqs 29 and 30.

        D are the edge points: a stray one has surface around it, but no edge. μ counts the length of edge within n
        instead of points, of which there are the fewer the farther something is; its threshold is not in the paper.
        Curves under 6 cm do not come as far as this: what goes here are short ones that stand alone.
        """
        config = self._config
        kernels.remove_noise(
            network.node_m,
            network.node_curve,
            cloud.curve_extent_m,
            self._beside,
            self._degree,
            network.nodes,
            config.node_reach_m,
            config.node_support_m,
            cloud.cell_width,
            cloud.edge_m,
            cloud.edges,
        )

    def _keep_important(self, network: Network, cloud: EdgeCloud) -> None:
        """Beyond the paper: what is narrow becomes a line, and what looks smallest goes when there are too many."""
        config = self._config
        outlines = kernels.list_outlines(self._beside, self._degree, network.nodes, self._member, self._start)
        parts = network.node_m, self._beside, self._degree, self._member, self._start, outlines
        kernels.flatten_narrow(*parts, config.narrow_cells, *self._evidence(cloud))
        kernels.keep_important(*parts, config.most_nodes, self._angle)
