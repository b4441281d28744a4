"""Post-processing of the network, in the paper's order (paper 1, sections 3.2.1-3.2.5)."""

from __future__ import annotations

import math

from robot_app.perception.config import RefineConfig
from robot_app.perception.learner import Network
from robot_app.perception.point_cloud import EdgeCloud
from robot_app.perception.refinement import _kernels as kernels


def refine(network: Network, cloud: EdgeCloud, config: RefineConfig) -> None:
    """Turn what was learned from `cloud` into outlines worth sending."""
    remove_ground(network, cloud, config)
    reduce_straight(network, cloud, config, keep_near_open_m=config.loop_reach_m)
    close_loops(network, cloud, config)
    reduce_straight(network, cloud, config, keep_near_open_m=0.0)
    remove_noise(network, cloud, config)
    remove_unsupported(network, cloud, config)
    network.drop_isolated()


def remove_ground(network: Network, cloud: EdgeCloud, config: RefineConfig) -> None:
    """Section 3.2.1, eqs 24 and 25.

    The text marks nodes *without* a neighbour above or below as ground, while eq 24 read with "for all i" would mark
    every node: the points of D are read as "there is one".
    """
    kernels.remove_ground(
        network.node_m,
        network.linked,
        network.nodes,
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
    network.drop_isolated()


def reduce_straight(network: Network, cloud: EdgeCloud, config: RefineConfig, keep_near_open_m: float) -> None:
    """Section 3.2.2, eq 26.

    The first time the nodes within `keep_near_open_m` of an open end stay, for closing loops is what they may be
    needed for; what was kept in vain goes the second time.
    """
    kernels.reduce_straight(
        network.node_m,
        network.linked,
        network.nodes,
        config.straight_angle_rad,
        config.straight_offset_m,
        keep_near_open_m,
        cloud.lens,
        cloud.stride,
        config.connection_reach_m,
        config.connection_step_m,
        cloud.edge_m,
        cloud.edge_at,
    )
    network.drop_isolated()


def close_loops(network: Network, cloud: EdgeCloud, config: RefineConfig) -> None:
    """Section 3.2.3, eqs 27 and 28."""
    kernels.close_loops(
        network.node_m,
        network.node_curve,
        network.linked,
        network.nodes,
        math.degrees(config.eta_angle_per_deg),
        config.eta_distance_per_m,
        config.loop_reach_m,
        cloud.lens,
        cloud.stride,
        config.connection_reach_m,
        config.connection_step_m,
        cloud.edge_m,
        cloud.edge_at,
    )


def remove_noise(network: Network, cloud: EdgeCloud, config: RefineConfig) -> None:
    """Section 3.2.4, eqs 29 and 30, with D the edge points: a stray edge point has surface around it, but no edge."""
    kernels.remove_noise(
        network.node_m,
        network.linked,
        network.nodes,
        config.node_reach_m,
        config.node_support_m,
        cloud.cell_width,
        cloud.edge_m,
        cloud.edges,
    )


def remove_unsupported(network: Network, cloud: EdgeCloud, config: RefineConfig) -> None:
    """Section 3.2.5, eqs 31-33, at points all along the connection and with D the edge points.

    The middle alone lets a connection cross from one object to the next where a third one lies in between.
    """
    kernels.remove_unsupported(
        network.node_m,
        network.linked,
        network.nodes,
        cloud.lens,
        cloud.stride,
        config.connection_reach_m,
        config.connection_step_m,
        cloud.edge_m,
        cloud.edge_at,
    )
