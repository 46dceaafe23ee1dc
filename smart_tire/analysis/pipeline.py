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

"""The estimators connected as in the nodes, without ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from smart_tire.analysis.smoothing import SmoothedSlip
from smart_tire.errors import ParameterError
from smart_tire.estimation import streams
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import (
    build, FrictionEstimatorParams, known_names, load_files, NODE_PARAMS, RobotParams,
    SlipEstimatorParams, specs)
from smart_tire.parameters.files import blocks_in, values_for
from smart_tire.parameters.snapshot import snapshot_text
from smart_tire.parameters.spec import values_of
from smart_tire.samples import (
    Friction, GroundState, Icr, ImuSample, Odometry, Sample, WheelSample, WheelSlip)

INPUTS, ESTIMATES = streams.INPUTS, streams.ESTIMATES
TRUTHS = tuple(f'ground_truth/{name}' for name in ('odom', 'wheel_slip', 'tire_friction'))

EstimateRecord = Odometry | WheelSlip | Icr | GroundState | Friction


@dataclass(frozen=True)
class EstimatorParams:
    """Parameters of both estimators."""

    slip: SlipEstimatorParams = field(default_factory=SlipEstimatorParams)
    friction: FrictionEstimatorParams = field(default_factory=FrictionEstimatorParams)

    @classmethod
    def load(cls, files: Iterable[str | Path]) -> EstimatorParams:
        """Return the parameters in ``files``, later ones override; raise ParameterError."""
        files, known = list(files), known_names(NODE_PARAMS.values())
        slip, friction = (
            load_files(files, node, known, specs(NODE_PARAMS[node]))
            for node in ('slip_estimator', 'friction_estimator'))
        return cls(build(SlipEstimatorParams, slip), build(FrictionEstimatorParams, friction))

    @classmethod
    def from_text(cls, text: str, where: str) -> EstimatorParams:
        """
        Return the parameters in the text of a parameter file, such as one stored in a bag.

        Names that are unknown to this version are ignored (``snapshot.unknown_names``). Raises
        ParameterError, with ``where`` the text is from, if a value is invalid.
        """
        blocks = blocks_in(text, where)
        slip, friction = (
            values_for(node, blocks, known_names([NODE_PARAMS[node]]))
            for node in ('slip_estimator', 'friction_estimator'))
        try:
            return cls(build(SlipEstimatorParams, slip), build(FrictionEstimatorParams, friction))
        except ParameterError as error:
            raise ParameterError(f'{where}: {error}') from error

    @property
    def text(self) -> str:
        """Return all parameters as the text of a parameter file."""
        return snapshot_text(self.by_node())

    def by_node(self) -> dict[str, dict[str, Any]]:
        """Return the flat parameters by node."""
        return {'slip_estimator': values_of(self.slip),
                'friction_estimator': values_of(self.friction)}

    @property
    def robot(self) -> RobotParams:
        """Return the robot parameters of the slip estimator."""
        return self.slip.robot


class SlipStage:
    """
    The slip estimator: inputs in; its estimates and the inputs of the friction estimator out.

    With ``slip.film_aided`` it contains a friction estimator, whose results it also forwards.
    """

    def __init__(self, params: EstimatorParams, slip: SlipEstimator | SmoothedSlip) -> None:
        self._slip = slip
        self._friction = (FrictionEstimator(params.friction)
                          if params.slip.robot.slip.film_aided else None)

    def update(self, sample: Sample) -> list[Sample]:
        """Process an input, in order of reception."""
        forwarded: list[Sample] = []
        if isinstance(sample, (ImuSample, WheelSample, GroundState)):
            forwarded += self._slip.update(sample)
        if type(sample) in streams.FRICTION.inputs:
            forwarded.append(sample)
        if self._friction is None:
            return forwarded
        return [output for item in forwarded for output in self._aid(self._friction, item)]

    def finish(self) -> list[Sample]:
        """Return the last output, at the end of all inputs."""
        return [] if self._friction is None else [*self._friction.finish()]

    def _aid(self, friction: FrictionEstimator, item: Sample) -> list[Sample]:
        """Return ``item`` and the friction estimates from it."""
        estimates = friction.update(item) if type(item) in streams.FRICTION.inputs else []
        return [item, *estimates]

    @property
    def late(self) -> Counter[str]:
        """Return topic -> number of late samples."""
        late = self._slip.late
        return late if self._friction is None else late | self._friction.late


class FrictionStage:
    """The friction estimator after the slip stage: output of that in, estimates out."""

    def __init__(self, params: FrictionEstimatorParams) -> None:
        self._friction = FrictionEstimator(params)

    def update(self, sample: Sample) -> list[EstimateRecord]:
        """Process output of the slip stage, in order."""
        estimates: list[EstimateRecord] = []
        if isinstance(sample, (Odometry, WheelSlip, Icr, GroundState)):
            estimates.append(sample)
        if type(sample) in streams.FRICTION.inputs:
            estimates += self._friction.update(sample)
        return estimates

    def finish(self) -> list[EstimateRecord]:
        """Return the last estimates, after all output of the slip stage."""
        return [*self._friction.finish()]

    @property
    def late(self) -> Counter[str]:
        """Return topic -> number of late samples."""
        return self._friction.late


class EstimatedFriction:
    """Replacement of the friction stage after a slip stage that estimates friction, too."""

    def update(self, sample: Sample) -> list[EstimateRecord]:
        """Return the estimates in the output of the slip stage."""
        return [sample] if isinstance(
            sample, (Odometry, WheelSlip, Icr, GroundState, Friction)) else []

    def finish(self) -> list[EstimateRecord]:
        """Return no estimates; the slip stage forwards them all."""
        return []

    @property
    def late(self) -> Counter[str]:
        """Return no late samples; those are counted by the slip stage."""
        return Counter()


def friction_stage(params: EstimatorParams) -> FrictionStage | EstimatedFriction:
    """Return the stage after a ``SlipStage`` with the same parameters."""
    if params.slip.robot.slip.film_aided:
        return EstimatedFriction()
    return FrictionStage(params.friction)


class Pipeline:
    """Both stages: inputs in, estimates out."""

    def __init__(self, params: EstimatorParams) -> None:
        self._slip = SlipStage(params, SlipEstimator(params.slip))
        self._friction = friction_stage(params)

    def update(self, sample: Sample) -> list[EstimateRecord]:
        """Process an input, in order of reception; return the estimates that it completes."""
        return [estimate for forwarded in self._slip.update(sample)
                for estimate in self._friction.update(forwarded)]

    def finish(self) -> list[EstimateRecord]:
        """Return the last estimates, at the end of all inputs."""
        return [*(estimate for forwarded in self._slip.finish()
                  for estimate in self._friction.update(forwarded)), *self._friction.finish()]
