# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Node ``film_sensor``: deflection of a buckling film from its charge and temperature."""

from __future__ import annotations

import sys

from smart_tire.estimation.film.estimator import FilmEstimator, MEASURING
from smart_tire.estimation.streams import FILM
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.estimator import EstimatorNode
from smart_tire.nodes.runner import run
from smart_tire.parameters.film import FilmSensorParams
from smart_tire.samples import FilmCharge
from std_srvs.srv import Trigger


class FilmSensorNode(EstimatorNode[FilmSensorParams]):
    """
    Estimates the deflection of a film, by the inverse of its hysteresis.

    Subscribes to ``film_charge`` and ``film_temperature``; publishes ``film_deflection`` and
    ``/diagnostics``. Service: ``zero_film``. Parameters: ``calibration_file``, ``zero_time``,
    ``fresh``, ``bandwidth``, ``pyroelectric_coefficient``, ``pyroelectric_tolerance``,
    ``temperature_rate``, ``temperature_sigma``, ``reorder_window``, ``reliability``, and those of
    the robot.
    """

    estimator: FilmEstimator

    def __init__(self) -> None:
        super().__init__('film_sensor', FilmSensorParams, FilmEstimator,
                         tuple(FILM.outputs.values()))
        for kind, name in FILM.inputs.items():
            self.subscribe(name, self.on_sample, required=kind is FilmCharge, announced=True,
                           reliability=self.params.reliability)
        self.create_service(Trigger, 'zero_film', self._on_zero)

    def finish(self) -> None:
        """Publish the last estimates of a replay."""
        for estimate in self.estimator.finish():
            self.publish_estimate(estimate)

    def _on_zero(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.estimator.zero()
        response.message = ('the present deflection is zero' if response.success else
                            self.estimator.state)
        return response

    def fill_status(self, status: Status) -> None:
        """Warn while nothing is measured."""
        super().fill_status(status)
        if self.estimator.state != MEASURING:
            status.warn(self.estimator.state)


def main() -> int:
    """Run the node."""
    return run(FilmSensorNode)


if __name__ == '__main__':
    sys.exit(main())
