"""Estimate odometry, slip and the ICR from ``imu/data`` and ``wheel_states``."""

from __future__ import annotations

import sys

from geometry_msgs.msg import TransformStamped
from std_srvs.srv import Trigger

from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.streams import SLIP
from smart_tire.messages import fill_transform
from smart_tire.nodes.base import run
from smart_tire.nodes.compat import transforms
from smart_tire.nodes.estimator import EstimatorNode
from smart_tire.nodes.qos import publisher_qos
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import Odometry, Sample


class SlipEstimatorNode(EstimatorNode[SlipEstimatorParams]):
    """The slip estimator with its topics, /tf where there is one, and its service."""

    core: SlipEstimator
    feedback = tuple(SLIP.aiding.values())

    def __init__(self) -> None:
        super().__init__('slip_estimator', SlipEstimatorParams, SlipEstimator,
                         tuple(SLIP.outputs.values()))
        for name in SLIP.inputs.values():
            self.subscribe(name, self.feed, reliability=self.params.reliability, required=True)
        if self.params.robot.slip.film_aided:
            for name in SLIP.aiding.values():
                self.subscribe(name, self.feed, wheels=len(self.params.robot.film.wheels))
        self.create_service(Trigger, 'reset_odometry', self._on_reset_odometry)
        self._tf = transforms()
        if self._tf is not None:
            self._tf_publisher = self.create_publisher(self._tf, '/tf', publisher_qos('/tf'))

    def put_out(self, estimate: Sample) -> None:
        """Publish one estimate; the pose as a transform, too."""
        super().put_out(estimate)
        if self._tf is not None and isinstance(estimate, Odometry):
            transform = fill_transform(TransformStamped(), estimate)
            self._tf_publisher.publish(self._tf(transforms=[transform]))

    def _on_reset_odometry(self, _: Trigger.Request,
                           response: Trigger.Response) -> Trigger.Response:
        self.core.reset_odometry()
        response.success = True
        response.message = 'odom starts where the robot stands'
        return response


def main() -> int:
    """Run the node."""
    return run(SlipEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
