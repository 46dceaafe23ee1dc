# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Trial of identified parameters: the slip estimator on their own recordings, with and without them.

Parameters are refused if the innovations become larger, or if the path ends farther from the
reference poses, where there are any: what is right in the model that it was identified with may
be wrong in that of the estimator. The innovations are not normalized: their variances change with
the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from smart_tire.analysis.metrics import compared_poses, rms
from smart_tire.arrays import Array
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.estimates import PoseEstimate
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.filter import SlipFilter
from smart_tire.estimation.slip.ground import ForceBalance
from smart_tire.estimation.slip.kalman import KalmanFilter
from smart_tire.estimation.slip.state import initial_state, State
from smart_tire.estimation.streams import SLIP
from smart_tire.identification.robot import NO_REFERENCE, reference_topic
from smart_tire.parameters import build, SlipEstimatorParams, specs
from smart_tire.parameters.calibration_file import Identified, Value
from smart_tire.parameters.spec import values_of
from smart_tire.recording import SampleArrays
from smart_tire.samples import ImuSample, Odometry, WheelSample

# relative losses: a right latency of 23 ms makes innovations on straight lines larger by 12 %, as
# wheels are compared with an older state (benchmarks.calibration, guided); of the end, chance
FIGURES = (('rms innovation of the rotation of wheels', 'rad', 0.25),
           ('rms innovation of the lateral speed', 'm/s', 0.25),
           ('distance of the ends of path and reference', 'm', 0.05))
Innovations = tuple[list[float], list[float]]
UNUSED = 'motor.', 'film.', 'pid.', 'effective_track'  # without a ground_state


class Recorded(NamedTuple):
    """Samples of IMU and wheels in order of reception, and reference poses if there are any."""

    samples: Sequence[ImuSample | WheelSample]
    reference: PoseEstimate | None


class TrialScore(NamedTuple):
    """How well the estimator predicts what it measures next, and follows the path."""

    rotation: float  # rad, rms innovation of the rotation of the wheels between two samples
    lateral: float   # m/s, of the lateral speed about the centers of rotation
    end: float       # m, distance of the end of the path from that of the reference

    def worse_than(self, other: TrialScore) -> str:
        """Return in which figures this is worse, '' if it is in none."""
        return ', '.join(f'{what} {ours:.3g} {unit} with it, {theirs:.3g} {unit} without'
                         for (what, unit, loss), ours, theirs in zip(FIGURES, self, other)
                         if ours > (1.0 + loss) * theirs)


def read_recorded(path: Path, params: SlipEstimatorParams, reference: str = NO_REFERENCE,
                  names: TopicNames = STANDARD_NAMES) -> Recorded:
    """Return what a bag has for a trial; ``reference`` as in ``read_recording``."""
    samples: list[ImuSample | WheelSample] = []
    poses = SampleArrays()
    with Bag(path, names, params.robot.joints) as bag:
        topic = reference_topic(bag, reference)
        for _, _, sample in bag.samples((*SLIP.inputs.values(), *([topic] if topic else []))):
            if isinstance(sample, Odometry):
                poses.add_sample(sample)
            elif isinstance(sample, (ImuSample, WheelSample)):
                samples.append(sample)
    return Recorded(samples, poses.poses() if topic else None)


def refusals(params: SlipEstimatorParams, found: Mapping[str, Identified],
             recordings: Sequence[Recorded]) -> dict[str, str]:
    """
    Return the parameters in ``found`` that make the estimates worse than ``params`` do, and how.

    All are tried together; if that is worse, one after the other, together with those before that
    are not. A parameter and its standard deviation are one.
    """
    best = _score(params, recordings)
    used = {name: one.value for name, one in found.items()
            if name in specs(SlipEstimatorParams) and not name.startswith(UNUSED)}
    if not _score(_with(params, used), recordings).worse_than(best):
        return {}
    refused = {}
    for group in dict.fromkeys(name.removesuffix('_sigma') for name in used):
        own = {name: value for name, value in used.items()
               if name.removesuffix('_sigma') == group}
        tried = _with(params, own)
        score = _score(tried, recordings)
        if worse := score.worse_than(best):
            refused.update(dict.fromkeys(own, f'{", ".join(map(str, own.values()))} was '
                                              f'identified, but tried on the recordings {worse}'))
        else:
            params, best = tried, TrialScore(*map(min, score, best))
    return refused


def _with(params: SlipEstimatorParams, values: Mapping[str, Value]) -> SlipEstimatorParams:
    return build(SlipEstimatorParams, {**values_of(params), **values})


def _score(params: SlipEstimatorParams, recordings: Sequence[Recorded]) -> TrialScore:
    """Return the score of all recordings."""
    innovations: Innovations = [], []
    end = 0.0
    for samples, reference in recordings:
        estimator, estimates = _Estimator(params, innovations), SampleArrays()
        for sample in samples:
            for estimate in estimator.update(sample):
                if isinstance(estimate, Odometry):
                    estimates.add_sample(estimate)
        if reference is not None:
            error = compared_poses(estimates.poses(), reference).error
            end += float(np.linalg.norm(error[-1, :2])) if len(error) else 0.0
    wheels, lateral = (rms(np.array(one)) if one else 0.0 for one in innovations)
    return TrialScore(wheels / params.robot.wheel_radius, lateral, end)


class _Kalman(KalmanFilter):
    """Kalman filter that keeps the innovations of wheels [m] and of ICR kinematics [m/s]."""

    def __init__(self, params: SlipEstimatorParams, innovations: Innovations) -> None:
        super().__init__(*initial_state(params))
        self._innovations = innovations

    def correct(self, y: float, h: Array, *arguments: Any) -> float:
        """Correct, and keep the innovation of the lateral speed about the ICRs."""
        if h[State.ICR_X]:
            self._innovations[1].append(y)
        return super().correct(y, h, *arguments)

    def correct_jointly(self, y: Array, *arguments: Any) -> float:
        """Correct, and keep the innovations of both rolled distances."""
        self._innovations[0].extend(y)
        return super().correct_jointly(y, *arguments)


class _Estimator(SlipEstimator):
    """Slip estimator whose innovations are kept, also those before a restart."""

    def __init__(self, params: SlipEstimatorParams, innovations: Innovations) -> None:
        def new_filter(*_: object) -> SlipFilter:
            made = SlipFilter(params)
            made.kalman = _Kalman(params, innovations)
            made.forces = ForceBalance(params.robot, made.kalman)
            return made
        self.new_filter = new_filter
        super().__init__(params)
