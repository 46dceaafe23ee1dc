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

"""
Jitter of the ``wheel_states`` timestamps, from positions that are smoother than the timestamps.

Over a few samples angles are a parabola in time. A timestamp error causes the same error in time
on both sides, whatever their speeds; fluctuations of the speeds differ between the sides.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import period, WheelRecord
from smart_tire.calibration.results import SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import mad_sigma
from smart_tire.parameters import RobotParams
from smart_tire.samples import LEFT, RIGHT
from smart_tire.uncertain import Uncertain

RESIDUAL_KERNEL = np.array([3.0, -12.0, 18.0, -12.0, 3.0]) / 35.0  # of a parabola in five samples
SLOPE_KERNEL = np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) / 10.0
RESIDUAL_VARIANCE_SHARE = 18.0 / 35.0  # of the residual over that of independent errors
MIN_COUNTS = 10.0  # of an encoder between samples, below which quantization hides the jitter
MAX_WINDOW = 0.5   # s of five samples: over longer times the speed is not linear in time
MIN_SAMPLES = 30   # below this number the residuals do not determine their scatter


def fit_jitter(wheels: WheelRecord, robot: RobotParams) -> Uncertain:
    """Return the standard deviation of a timestamp [s]; EstimatorError if not observable."""
    if wheels.position is None:
        raise EstimatorError('wheel_states have no positions')
    if len(wheels.time) < len(RESIDUAL_KERNEL):
        raise EstimatorError(f'{len(wheels.time)} samples')
    step = period(wheels.time)
    if 4.0 * step > MAX_WINDOW:
        raise EstimatorError(f'five samples last {4.0 * step:.2g} s, expected at most '
                             f'{MAX_WINDOW:g} s: the wheels change their speed meanwhile')
    sides = [wheels.position[:, side].mean(axis=1) for side in (LEFT, RIGHT)]
    increment, angle_residual = (np.stack([_filtered(side, kernel) for side in sides], axis=1)
                                 for kernel in (SLOPE_KERNEL, RESIDUAL_KERNEL))
    gaps = np.lib.stride_tricks.sliding_window_view(np.diff(wheels.time), 4)
    count = math.tau / robot.encoder.counts_per_revolution
    usable = (np.abs(gaps - step).max(axis=1) < 0.5 * step) & (
        np.abs(increment).min(axis=1) > MIN_COUNTS * count)
    if usable.sum() < MIN_SAMPLES:
        raise EstimatorError(f'{int(usable.sum())} samples with both sides in motion, expected at '
                             f'least {MIN_SAMPLES}')
    errors = _filtered(wheels.time, RESIDUAL_KERNEL)[usable, None] - (
        angle_residual[usable] / increment[usable]
        * _filtered(wheels.time, SLOPE_KERNEL)[usable, None])
    return _common_sigma(errors)


def _filtered(values: Array, kernel: Array) -> Array:
    return np.asarray(np.convolve(values, kernel[::-1], 'valid'))


def _common_sigma(errors: Array) -> Uncertain:
    """Return the standard deviation of the common part of two columns of errors (n, 2)."""
    common, differential = (mad_sigma(errors @ sign) for sign in ((1, 1), (1, -1)))
    variance = (common ** 2 - differential ** 2) / 4.0 / RESIDUAL_VARIANCE_SHARE
    # standard error of a variance by the median absolute deviation of n / 2 independent errors
    variance_sigma = (common ** 2 + differential ** 2) / 4.0 / RESIDUAL_VARIANCE_SHARE * (
        2.0 * math.sqrt(2.7 / len(errors)))
    if variance < SIGNIFICANT_SIGMAS * variance_sigma:
        limit = math.sqrt(max(variance, 0.0) + SIGNIFICANT_SIGMAS * variance_sigma)
        raise EstimatorError(f'speed fluctuations exceed the jitter (below {limit:.2g} s)')
    return Uncertain(math.sqrt(variance), 0.5 * variance_sigma / math.sqrt(variance))
