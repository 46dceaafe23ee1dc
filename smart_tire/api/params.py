# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of robot, estimators and simulator together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.errors import printable
from smart_tire.parameters import (
    build, FrictionEstimatorParams, known_names, load_node, NODE_PARAMS, RobotParams,
    SimulatorParams, SlipEstimatorParams)
from smart_tire.parameters.files import check_names
from smart_tire.parameters.spec import is_known, values_of

MAX_REPR = 480  # characters


@dataclass(frozen=True, repr=False)
class Params:
    """Parameters of both estimators and of the simulator; by default the robot of paper B."""

    estimators: EstimatorParams = field(default_factory=EstimatorParams)
    simulator: SimulatorParams = field(default_factory=SimulatorParams)

    @property
    def robot(self) -> RobotParams:
        """Geometry, mass, tires, films and sensors: ``config/robot.yaml``."""
        return self.estimators.robot

    def with_seed(self, seed: int) -> Params:
        """Return the same parameters with another seed of the simulator."""
        return replace(self, simulator=replace(self.simulator, seed=seed))

    def with_values(self, values: Mapping[str, Any]) -> Params:
        """
        Return the same parameters with other ``values``, as those of ``load_params``.

        Raises ParameterError for an unknown name, or a value that is not allowed.
        """
        check_names(values, known_names(NODE_PARAMS.values()))
        slip, friction, simulator = (
            values_of(one) | {name: value for name, value in values.items()
                              if is_known(name, known_names([type(one)]))} for one in self._parts)
        return Params(EstimatorParams(build(SlipEstimatorParams, slip),
                                      build(FrictionEstimatorParams, friction)),
                      build(SimulatorParams, simulator))

    @property
    def _parts(self) -> tuple[SlipEstimatorParams, FrictionEstimatorParams, SimulatorParams]:
        return self.estimators.slip, self.estimators.friction, self.simulator

    def _values(self) -> dict[str, Any]:
        return {name: value for one in self._parts for name, value in values_of(one).items()}

    def __repr__(self) -> str:
        default = Params()._values()
        return printable('Params({})'.format(', '.join(
            f'{name}: {value}' for name, value in self._values().items()
            if value != default.get(name)) or 'defaults'), MAX_REPR)


def load_params(*files: str | Path, values: Mapping[str, Any] | None = None) -> Params:
    """
    Return the parameters in ROS parameter files, with ``values`` on top.

    Later files override earlier ones. ``values`` maps names of ``docs/parameters.md``, such as
    ``'film.wheels'``, to values in the units given there; each applies to all that have it.
    Without arguments all parameters have their defaults. Raises ParameterError for an unknown
    name, a value that is not allowed, or a file that cannot be read.
    """
    given = dict(values or {})
    check_names(given, known_names(NODE_PARAMS.values()))
    slip, friction, simulator = (load_node(files, node, given) for node in (
        'slip_estimator', 'friction_estimator', 'robot_simulator'))
    return Params(EstimatorParams(slip, friction), simulator)
