# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Node ``friction_estimator``: friction under each instrumented wheel, state of the ground."""

from __future__ import annotations

import sys

from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.streams import FRICTION
from smart_tire.nodes.base import run
from smart_tire.nodes.estimator import EstimatorNode
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import TireSample


class FrictionEstimatorNode(EstimatorNode[FrictionEstimatorParams]):
    """
    Estimates the friction coefficient of each patch crossing, and the state of the ground.

    Subscribes to ``imu/data``, ``wheel_states``, ``tire_samples`` and, where no IMU publishes,
    ``odom``; publishes ``tire_friction``, ``ground_state`` and ``/diagnostics``.

    Parameters: ``reorder_window``, ``method``, ``map``, ``load_sigma``, ``reliability``, and those
    of the robot.
    """

    feedback = ('odom',)  # in a replay it comes after the order of the inputs is known

    def __init__(self) -> None:
        super().__init__('friction_estimator', FrictionEstimatorParams, FrictionEstimator,
                         tuple(FRICTION.outputs.values()))
        wheels = len(self.params.robot.film.wheels)
        for kind, name in FRICTION.inputs.items():
            self.subscribe(name, self.on_sample, wheels=wheels if kind is TireSample else 1,
                           required=name != 'odom', announced=True,
                           reliability=self.params.reliability,
                           from_msg=self.conversion(name, self.params.robot.joints))

    def finish(self) -> None:
        """Publish the last crossings of a replay."""
        assert isinstance(self.estimator, FrictionEstimator)
        for estimate in self.estimator.finish():
            self.publish_estimate(estimate)


def main() -> int:
    """Run the node."""
    return run(FrictionEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
