# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``friction_estimator``: friction under each instrumented wheel, state of the ground."""

from __future__ import annotations

from functools import cache
from importlib import import_module
import sys
from typing import Any

from rclpy.subscription import Subscription
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.streams import FRICTION
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.estimator import EstimatorNode
from smart_tire.nodes.hand_over import Inbox
from smart_tire.nodes.runner import run
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import GROUND_ESTIMATES, GroundState, Odometry, Sample, TireSample

ODOM = FRICTION.inputs[Odometry]
# imported at their first use, by the first crossing, which would be late: ground_state is awaited
USED_BY_CROSSINGS = 'scipy.linalg.lapack', 'scipy.special'
IMU_WAIT = 2.0  # s with wheel_states and without imu/data until odom replaces it


class FrictionEstimatorNode(EstimatorNode[FrictionEstimatorParams]):
    """
    Estimates the friction coefficient of each patch crossing, and the state of the ground.

    Subscribes to ``imu/data``, ``wheel_states``, ``tire_samples`` and, where wheels but no IMU
    are received, ``odom``; publishes ``tire_friction``, ``ground_state`` and ``/diagnostics``.

    Parameters: ``reorder_window``, ``load_sigma``, ``reliability``, and those of the robot.
    """

    # less than ground_delay, after which ground_state is awaited; more than a fit takes
    paced_by, pace_lag_ns = 'imu/data', 150_000_000

    def __init__(self) -> None:
        self._odom: Subscription[Any] | Inbox | None = None
        self._wheels_before = 0  # wheel samples until the latest check
        super().__init__('friction_estimator', FrictionEstimatorParams, FrictionEstimator,
                         tuple(FRICTION.outputs.values()))
        wheels = len(self.params.robot.film.wheels)
        for kind, name in FRICTION.inputs.items():
            if kind is not Odometry:
                self.subscribe(name, self.on_sample, wheels=wheels if kind is TireSample else 1,
                               required=kind is not TireSample or wheels > 0,
                               reliability=self.params.reliability,
                               from_msg=self.conversion(name, self.params.robot.joints),
                               urgent=kind is not TireSample)  # at least 400 Hz, with the next IMU
        self.call_every(IMU_WAIT, self._choose_odom, wakes=False)

    def on_sample(self, sample: Sample | None) -> None:
        """Process a sample; import what crossings need with the first one, before the drive."""
        import_for_crossings()
        super().on_sample(sample)

    def restart(self) -> None:
        """Replace the estimator by a new one; a replay has no odometry in place of the IMU."""
        super().restart()
        self._ground: GroundState | None = None
        self._end_odom()

    def _choose_odom(self) -> None:
        """Subscribe to odometry only while there are wheels but no IMU: it has 125 Hz."""
        imu, wheels = self.inputs['imu/data'].ok, self.inputs['wheel_states'].ok
        if imu:
            self._end_odom()
        elif (self._odom is None and wheels > self._wheels_before > 0
                and not self._follower.leader):
            self.get_logger().warning(f'no imu/data: the motion is that of {ODOM}')
            self._odom = self.subscribe(ODOM, self.on_sample, announced=True,
                                        reliability=self.params.reliability)
        self._wheels_before = wheels

    def _end_odom(self) -> None:
        if self._odom is not None:
            self.unsubscribe(ODOM, self._odom)
            self._follower.remove_input(self.resolve_topic_name(ODOM))
            self._odom = None

    def publish_estimate(self, estimate: Sample) -> None:
        """Publish one estimate."""
        super().publish_estimate(estimate)
        if isinstance(estimate, GroundState):
            self._ground = estimate

    def fill_status(self, status: Status) -> None:
        """Add the latest state of the ground; the estimator adds why there is none."""
        super().fill_status(status)
        if self._ground is not None:
            for name in GROUND_ESTIMATES:
                value, sigma = getattr(self._ground, name)
                status.values[f'ground.{name}'] = (
                    f'{value:.4g} +- {sigma:.2g}' if value == value else 'unknown')

    def finish(self) -> None:
        """Publish the last crossings of a replay."""
        assert isinstance(self.estimator, FrictionEstimator)
        for estimate in self.estimator.finish():
            self.publish_estimate(estimate)


@cache
def import_for_crossings() -> None:
    """Import what the first crossing uses, which would be late otherwise."""
    for name in USED_BY_CROSSINGS:
        import_module(name)


def main() -> int:
    """Run the node."""
    return run(FrictionEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
