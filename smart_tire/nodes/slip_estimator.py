# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``slip_estimator``: odometry, slip and ICR from IMU, wheels and the state of the ground."""

from __future__ import annotations

from collections.abc import Callable
import sys
from typing import Any

from geometry_msgs.msg import TransformStamped
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.odometry import OdometryOutput
from smart_tire.estimation.streams import HOLDING, SLIP
from smart_tire.messages import imu_mounting_to_msg, transform_to_msg
from smart_tire.nodes.compat import installed_class
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.estimator import EstimatorNode
from smart_tire.nodes.live_checks import LiveChecks
from smart_tire.nodes.qos import publisher_qos
from smart_tire.nodes.runner import run
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import quaternion
from smart_tire.samples import ImuSample, Odometry, Sample, WheelSample
from std_srvs.srv import Trigger

MAX_BIAS_SHARE = 0.2  # of its prior, standard deviation of the gyro bias once it is determined


class SlipEstimatorNode(EstimatorNode[SlipEstimatorParams]):
    """
    Estimates pose, velocity, slip of each wheel and center of rotation.

    Subscribes to ``imu/data``, ``wheel_states`` and ``ground_state``; publishes ``odom``,
    ``wheel_slip``, ``icr``, ``/diagnostics`` and, if tf2_msgs is installed, ``/tf`` (with
    ``publish_tf``) and ``/tf_static`` (with ``publish_imu_tf``). Service: ``reset_odometry``.

    Parameters: ``reorder_window``, ``differential_slip_sigma``, ``common_slip_sigma``,
    ``free_rolling_slip_sigma``, ``icr_x``, ``icr_x_sigma``, ``lateral_sigma``, ``slope_sigma``,
    ``ground_delay``, ``odom_rate``, ``odom_twist``, ``publish_imu_tf``, ``reliability``, and
    those of the robot.
    """

    estimator: SlipEstimator

    # less than reorder_window: wheel_states that the driver sends in time are not dropped
    paced_by, pace_lag_ns = 'imu/data', 25_000_000

    def __init__(self) -> None:
        super().__init__('slip_estimator', SlipEstimatorParams, SlipEstimator,
                         tuple(SLIP.outputs.values()))
        self.checks = LiveChecks(self.params.robot)
        for name in SLIP.inputs.values():
            self.subscribe(name, self.on_sample, reliability=self.params.reliability,
                           required=name not in HOLDING,
                           from_msg=self.conversion(name, self.params.robot.joints))
        self.create_service(Trigger, 'reset_odometry', self._on_reset_odometry)
        transforms = installed_class('tf2_msgs/msg/TFMessage')
        self._publish_transform: Callable[[Odometry], None] | None = None
        if transforms is not None and self.params.robot.publish_tf:
            self._publish_transform = self._transform_publisher(transforms)
        if transforms is not None and self.params.publish_imu_tf:
            self._publish_imu_mounting(transforms)

    def _transform_publisher(self, cls: type[Any]) -> Callable[[Odometry], None]:
        publisher = self.create_publisher(cls, '/tf', publisher_qos('/tf'))
        to_msg = self.in_frames(transform_to_msg)
        return lambda sample: publisher.publish(
            cls(transforms=[to_msg(TransformStamped(), sample)]))

    def _publish_imu_mounting(self, cls: type[Any]) -> None:
        """Publish the pose of the IMU once: the topic keeps it for late subscribers."""
        imu = self.params.robot.imu
        transform = self.in_frames(imu_mounting_to_msg)(
            TransformStamped(), self.now_ns(), imu.position, quaternion(*imu.rotation))
        publisher = self.create_publisher(cls, '/tf_static', publisher_qos('/tf_static'))
        publisher.publish(cls(transforms=[transform]))

    def on_sample(self, sample: Sample | None) -> None:
        """Process a sample of any input; IMU and wheels are checked as well."""
        super().on_sample(sample)
        if isinstance(sample, ImuSample | WheelSample) and (received := self.now_ns()):
            self.checks.add(received, sample)

    def restart(self) -> None:
        """Replace the estimator by a new one, whose gyro bias is unknown."""
        super().restart()
        self._is_initialized = False
        self._odometry = OdometryOutput(self.params)

    def fill_status(self, status: Status) -> None:
        """Add the state of the estimator; log when a rest has determined the gyro bias."""
        super().fill_status(status)
        if new := status.new('restarts', self.estimator.restarts):
            text = f'{new} restarts from the priors: the state was not finite'
            status.warn(text)
            self.get_logger().warning(text)
        if new := status.new('clock', int(status.values['clock_jumps'])):
            text = f'the clock of the inputs was set, {new} times: the pose goes on'
            status.warn(text)
            self.get_logger().warning(text)
        for error in self.checks.poll(
                self.now_ns(), status.host or self.host_load, self.completed):
            status.error(error.text)
            if status.new(error.where + error.action, 1):
                self.get_logger().error(error.text)
        bias = self.estimator.gyro_bias
        if not self._is_initialized and (
                bias.sigma < MAX_BIAS_SHARE * self.params.robot.imu.gyro_bias):
            self._is_initialized = True
            self.get_logger().info(f'initialized: gyro bias {bias.value:+.4f} rad/s, standard '
                                   f'deviation {bias.sigma:.4f} rad/s, from standstill')

    def publish_estimate(self, estimate: Sample) -> None:
        """Publish one estimate, odometry at its own rate; the pose also as a transform."""
        if isinstance(estimate, Odometry):
            message = self._odometry.message(estimate)
            if message is None:
                return
            estimate = message
            if self._publish_transform is not None:
                self._publish_transform(estimate)
        super().publish_estimate(estimate)

    def _on_reset_odometry(self, _: Trigger.Request,
                           response: Trigger.Response) -> Trigger.Response:
        self.estimator.reset_odometry()
        self._odometry.reset()
        response.success = True
        response.message = 'the origin of odom is at the present pose'
        return response


def main() -> int:
    """Run the node."""
    return run(SlipEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
