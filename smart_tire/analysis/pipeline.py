"""The estimators as the nodes run them, one feeding the other, without nodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from smart_tire.estimation.friction_estimator import FrictionEstimator
from smart_tire.estimation.slip_estimator import SlipEstimator
from smart_tire.parameters import (
    build, FrictionEstimatorParams, known_names, load_files, NODE_PARAMS, RobotParams,
    SlipEstimatorParams, specs)
from smart_tire.samples import (
    Friction, Icr, ImuSample, Odometry, Sample, TireSample, WheelSample, WheelSlip)

INPUTS = ('imu/data', 'wheel_states', 'tire_samples')
ESTIMATES = ('odom', 'wheel_slip', 'icr', 'tire_friction')
TRUTHS = tuple(f'ground_truth/{name}' for name in ('odom', 'wheel_slip', 'tire_friction'))

Estimate = Odometry | WheelSlip | Icr | Friction


@dataclass(frozen=True)
class EstimatorParams:
    """What parameter files say to the two estimators."""

    slip: SlipEstimatorParams = field(default_factory=SlipEstimatorParams)
    friction: FrictionEstimatorParams = field(default_factory=FrictionEstimatorParams)

    @classmethod
    def load(cls, files: Iterable[str | Path]) -> EstimatorParams:
        """Return the parameters that ``files`` give, later ones win; raise ParameterError."""
        files, known = list(files), known_names(NODE_PARAMS.values())
        slip, friction = (
            load_files(files, node, known, specs(NODE_PARAMS[node]))
            for node in ('slip_estimator', 'friction_estimator'))
        return cls(build(SlipEstimatorParams, slip), build(FrictionEstimatorParams, friction))

    @property
    def robot(self) -> RobotParams:
        """Return the robot as the slip estimator sees it."""
        return self.slip.robot


class Pipeline:
    """Slip estimator and friction estimator in a row: inputs in, estimates out."""

    def __init__(self, params: EstimatorParams) -> None:
        self._slip = SlipEstimator(params.slip)
        self._friction = FrictionEstimator(params.friction)

    def update(self, sample: Sample) -> list[Estimate]:
        """Take an input in the order of reception; return what can be told since."""
        estimates: list[Estimate] = []
        if isinstance(sample, (ImuSample, WheelSample)):
            for estimate in self._slip.update(sample):
                estimates.append(estimate)
                if isinstance(estimate, (Odometry, WheelSlip)):
                    estimates += self._friction.update(estimate)
        if isinstance(sample, (TireSample, WheelSample)):
            estimates += self._friction.update(sample)
        return estimates

    @property
    def late(self) -> Counter[str]:
        """Return topic -> samples that came too late for an estimator."""
        return self._slip.late | self._friction.late  # the greater one where both take a topic
