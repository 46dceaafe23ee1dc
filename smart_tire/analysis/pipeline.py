"""The estimators connected as in the nodes, without ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from smart_tire.analysis.smoothing import SmoothedSlip
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.slip.estimator import SlipEstimator
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

    @property
    def robot(self) -> RobotParams:
        """Return the robot parameters of the slip estimator."""
        return self.slip.robot


class SlipStage:
    """
    The slip estimator: inputs in; its estimates, and what the friction estimator needs, out.

    ``films`` is a friction estimator of its own, for one that is aided by the films: what it says
    goes back into it.
    """

    def __init__(self, slip: SlipEstimator | SmoothedSlip,
                 films: FrictionEstimator | None = None) -> None:
        self._slip, self._films = slip, films

    @classmethod
    def of(cls, params: EstimatorParams, slip: SlipEstimator | SmoothedSlip) -> SlipStage:
        """Return the stage with all that ``params`` ask for."""
        aided = params.slip.robot.slip.film_aided
        return cls(slip, FrictionEstimator(params.friction) if aided else None)

    def update(self, sample: Sample) -> list[Sample]:
        """Take an input in the order of reception."""
        passed: list[Sample] = []
        if isinstance(sample, (ImuSample, WheelSample)):
            passed += self._slip.update(sample)
        if isinstance(sample, (TireSample, WheelSample)):
            passed.append(sample)
        if self._films is not None:
            self._aid(self._films, passed)
        return passed

    def _aid(self, films: FrictionEstimator, passed: list[Sample]) -> None:
        for item in passed:
            if not isinstance(item, Icr):
                for crossing in films.update(item):
                    self._slip.update(crossing)

    @property
    def late(self) -> Counter[str]:
        """Return topic -> samples that came too late."""
        return self._slip.late


class FrictionStage:
    """The friction estimator behind the slip estimator: what that passes in, estimates out."""

    def __init__(self, params: EstimatorParams) -> None:
        self._friction = FrictionEstimator(params.friction)

    def update(self, sample: Sample) -> list[Estimate]:
        """Take what the slip stage passes on, in order."""
        estimates: list[Estimate] = []
        if isinstance(sample, (Odometry, WheelSlip, Icr)):
            estimates.append(sample)
        if not isinstance(sample, Icr):
            estimates += self._friction.update(sample)
        return estimates

    @property
    def late(self) -> Counter[str]:
        """Return topic -> samples that came too late."""
        return self._friction.late


class Pipeline:
    """Both stages in one: inputs in, estimates out."""

    def __init__(self, params: EstimatorParams) -> None:
        self._slip = SlipStage.of(params, SlipEstimator(params.slip))
        self._friction = FrictionStage(params)

    def update(self, sample: Sample) -> list[Estimate]:
        """Take an input in the order of reception; return what can be told since."""
        return [estimate for passed in self._slip.update(sample)
                for estimate in self._friction.update(passed)]
