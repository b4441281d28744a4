"""3D objects from depth images (paper 1, section 3.2, figure 9)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_app.drivers.base import DepthImage
from robot_app.perception.config import PerceptionConfig
from robot_app.perception.learner import Learner, Network
from robot_app.perception.network._kernels import label_clusters
from robot_app.perception.point_cloud import EdgeCloud, Mount
from robot_app.perception.refine import Refiner
from robot_app.perception.simplified_fast_gng import SimplifiedFastGng
from shared.geometry.camera import Intrinsics
from shared.messages import ObjectNetwork


class ObjectExtractor:
    """Takes one depth image after the other; its memory is allocated here, once. Not for two threads at a time.

    Equal extractors (same configuration and camera) give equal networks for equal images. `learner`: another than
    simplified FastGNG, to compare it.
    """

    def __init__(
        self,
        config: PerceptionConfig,
        intrinsics: Intrinsics,
        mount: Mount,
        learner: Learner | None = None,
    ) -> None:
        self._shape = (intrinsics.height, intrinsics.width)
        self._robot_from_optical = mount.robot_from_optical().astype(np.float32)
        self._learner = learner or SimplifiedFastGng(config.learning, config.refine, config.edges.max_samples)
        self._knows_curves = learner is None
        self.cloud = EdgeCloud(config.edges, intrinsics, mount)
        self.network = Network(config.learning.max_nodes)
        self._refiner = Refiner(config.refine, config.learning.max_nodes, config.edges.max_samples)

    def extract(self, image: DepthImage) -> ObjectNetwork:
        """The outlines of what `image` shows, robot frame. Raises ValueError when its size is not the camera's."""
        self.find_edges(image)
        self.learn()
        self.refine()
        return self.objects()

    def find_edges(self, image: DepthImage) -> None:
        """Step 1."""
        self.cloud.update(image)

    def learn(self) -> None:
        """Steps 2-7."""
        self._learner.learn(self.cloud, self.network)
        if not self._knows_curves:
            self._refiner.find_curves(self.network, self.cloud)

    def refine(self) -> None:
        """Sections 3.2.1-3.2.5."""
        self._refiner.refine(self.network, self.cloud)

    def objects(self) -> ObjectNetwork:
        """The network as it stands, robot frame."""
        rotation, origin_m = self._robot_from_optical[:3, :3], self._robot_from_optical[:3, 3]
        nodes_m = self.network.node_m[: self.network.nodes] @ rotation.T + origin_m
        return ObjectNetwork(nodes_m, self.network.connections().astype(np.uint16))

    def warm_up(self) -> None:
        """Compile every kernel, on a picture of a box."""
        height, width = self._shape
        depth = np.full(self._shape, 3000, np.uint16)
        depth[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4] = 1000
        self.extract(DepthImage(0.0, depth, 0.001))


def clusters(objects: ObjectNetwork) -> NDArray[np.int32]:
    """(N,) the object that each node belongs to, numbered from 0: the connected components."""
    cluster_of = np.empty(len(objects.nodes_m), np.int32)
    label_clusters(objects.edges.astype(np.int32), cluster_of)
    return cluster_of
