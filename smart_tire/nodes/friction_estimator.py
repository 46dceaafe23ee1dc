"""Estimate the friction under each instrumented wheel from ``tire_samples``."""

from __future__ import annotations

import sys

from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.nodes.base import run
from smart_tire.nodes.estimator import EstimatorNode
from smart_tire.parameters import FrictionEstimatorParams


class FrictionEstimatorNode(EstimatorNode[FrictionEstimatorParams]):
    """The friction estimator with its topics."""

    def __init__(self) -> None:
        super().__init__('friction_estimator', FrictionEstimatorParams, FrictionEstimator,
                         ('tire_friction',))
        wheels = len(self.params.robot.film.wheels)
        for name, sources in (('tire_samples', wheels), ('wheel_states', 1), ('wheel_slip', 1),
                              ('odom', 1)):
            self.subscribe(name, self.feed, wheels=sources, required=True,
                           reliability=self.params.reliability)


def main() -> int:
    """Run the node."""
    return run(FrictionEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
