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
Cross-validation of identified parameters: fitted on one half of a recording, tested on the other.

The halves are interleaved blocks, so both contain all phases of a recording; where possible they
change at standstill. A value is accepted if it predicts the measurements of the other half better
than the configured one, in both directions, and the improvement exceeds its scatter over blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import DelayProblem
from smart_tire.numerics.regression import HUBER_THRESHOLD, robust_regression
from smart_tire.numerics.robust import mad_sigma, noise_level

BLOCKS = 12                  # of a recording; even ones are one half, odd ones the other
MIN_BLOCKS = 4               # of the minimum length, two for each half
MIN_BLOCK, MAX_BLOCK = 4.0, 20.0  # s; shorter gaps would be bridged by the wheel positions
STANDSTILL_SHARE = 0.3       # of a block by which its end may move to a standstill
STATIONARY_SPEED = 0.02      # rad/s, of wheels at standstill
SCORE_INTERVAL = 2.0         # s, over which errors may be correlated
MIN_IMPROVEMENT_SIGMAS = 2.0  # standard errors of the improvement on both halves together
EFFECTIVE_SHARE = 0.3        # of samples, independent ones of a level from medians
MIN_LIKELIHOOD_GAIN = 2.0     # of the logarithm, in each phase
NOISE_WINDOW = 1.0           # s
MIN_WINDOW_SAMPLES = 10      # of the IMU
MAX_STEP_RATIO = 1.5         # of neighboring rows, over the median
MIN_SCORES = 4               # intervals of each half, to estimate the scatter


@dataclass(frozen=True)
class Prediction:
    """Errors of measurements of one half, predicted with two values."""

    time: Array        # (n,) s
    configured: Array  # (n,) errors with the configured value
    identified: Array  # (n,) errors with the value identified from the other half


@dataclass(frozen=True)
class Verdict:
    """Whether a value is written, and why (not)."""

    accepted: bool
    reason: str
    contradicted: bool = False  # whether the errors on the other half are larger, not just alike
    spread: float = 0.0         # standard error of the value from the difference of the halves


def halves(recording: Recording) -> tuple[Recording, Recording]:
    """
    Return wheels and reference of both halves; each has all IMU samples.

    Raises EstimatorError if the recording is too short.
    """
    wheels = recording.wheels
    if not np.ptp(wheels.time) >= MIN_BLOCKS * MIN_BLOCK:
        raise EstimatorError(f'the recording lasts {np.ptp(wheels.time):.0f} s, expected at least '
                             f'{MIN_BLOCKS * MIN_BLOCK:.0f} s for a cross-validation')
    ends = _block_ends(wheels.time, np.abs(wheels.velocity).max(axis=1) < STATIONARY_SPEED)

    def half(parity: int) -> Recording:
        own = np.searchsorted(ends, wheels.time) % 2 == parity
        poses = recording.reference
        if poses is not None:
            chosen = np.searchsorted(ends, poses.time) % 2 == parity
            poses = replace(poses, time=poses.time[chosen], position=poses.position[chosen],
                            yaw=poses.yaw[chosen])
        return replace(recording, reference=poses, wheels=replace(
            wheels, time=wheels.time[own], velocity=wheels.velocity[own],
            position=None if wheels.position is None else wheels.position[own]))
    return half(0), half(1)


def _block_ends(time: Array, stationary: NDArray[np.bool_]) -> Array:
    """Return the ends [s] of the blocks, at standstill where there is one nearby."""
    length = min(max(float(np.ptp(time)) / BLOCKS, MIN_BLOCK), MAX_BLOCK)
    still, ends = time[stationary], []
    for end in np.arange(time[0] + length, time[-1], length):
        near = still[np.abs(still - end) < STANDSTILL_SHARE * length]
        ends.append(float(near[np.argmin(np.abs(near - end))]) if len(near) else float(end))
    return np.array(ends)


def both_ways(parts: Sequence[Recording],
              predict: Callable[[Recording, Recording], Prediction]) -> list[Prediction]:
    """Return ``predict(fitted, tested)`` for both orders of the halves."""
    first, second = parts
    return [predict(first, second), predict(second, first)]


def verdict(predictions: Sequence[Prediction], unit: str) -> Verdict:
    """Return whether the errors with the identified value are smaller, in both directions."""
    gains, texts, worse, contradicted = [], [], False, False
    for prediction in predictions:
        before, after = _clipped_squares(prediction)
        group = np.floor(prediction.time / SCORE_INTERVAL)
        gain = np.array([np.sum((before - after)[group == number]) for number in np.unique(group)])
        if len(gain) < MIN_SCORES:
            return Verdict(False, f'{len(gain)} intervals of {SCORE_INTERVAL:g} s in one half of '
                                  f'the recording, expected at least {MIN_SCORES}')
        worse |= bool(np.sum(gain) <= 0.0)
        contradicted |= float(np.sum(gain)) < -math.sqrt(len(gain) * float(np.var(gain, ddof=1)))
        gains.append(gain / float(np.sum(before)))
        texts.append(f'{math.sqrt(np.mean(before)):.4g} -> {math.sqrt(np.mean(after)):.4g} {unit}')
    improvement = sum(float(np.sum(gain)) for gain in gains)
    sigma = math.sqrt(sum(len(gain) * float(np.var(gain, ddof=1)) for gain in gains))
    errors = 'errors on the other half ' + ' and '.join(texts)
    if worse:
        return Verdict(False, f'no improvement on the other half: {errors}', contradicted)
    if improvement < MIN_IMPROVEMENT_SIGMAS * sigma:
        return Verdict(False, f'no significant improvement on the other half: {errors}')
    return Verdict(True, errors)


def _clipped_squares(prediction: Prediction) -> tuple[Array, Array]:
    """Return the squared errors, without the weight of outliers."""
    both = prediction.configured, prediction.identified
    limit = HUBER_THRESHOLD * min(max(mad_sigma(errors), 1e-12) for errors in both) * 2.0
    before, after = (np.clip(errors, -limit, limit) ** 2 for errors in both)
    return before, after


def delay_prediction(fitted: DelayProblem, tested: DelayProblem, configured: float,
                     identified: float) -> Prediction:
    """Return the errors of ``tested`` with two delays [s] and the coefficients of ``fitted``."""
    def errors(delay: float) -> Array:
        rows = fitted.rows(delay)
        coefficients = robust_regression(
            rows.matrix, rows.target, fitted.prior, model_sigma=fitted.model_sigma(delay),
            initial_sigma=mad_sigma(rows.target) or 1.0, hac_lags=0).coefficients
        other = tested.rows(delay)
        return np.diff(other.target - other.matrix @ coefficients)[neighbors]

    # a delay shows in changes; slow errors from slip are common to neighboring rows
    steps = np.diff(tested.time)
    neighbors = steps < MAX_STEP_RATIO * np.median(steps)
    return Prediction(tested.time[1:][neighbors], errors(configured), errors(identified))


def noise_verdict(parts: Sequence[Recording], signal: Callable[[Recording], Array],
                  configured: float, unit: str) -> Verdict:
    """
    Return whether the noise at standstill describes the other half better than ``configured``.

    ``signal`` returns the columns (n, k) of the IMU samples. The score is the logarithmic
    likelihood of the noise levels of windows, also of those in motion: the estimators use the
    value there, and vibration can be a hundred times the noise at standstill.
    """
    levels = [_noise_levels(part, signal(part)) for part in parts]
    for own, other in (levels, levels[::-1]):
        if not len(own['standstill']):
            return Verdict(False, 'no standstill in one half of the recording')
        identified = float(np.median(own['standstill']))
        if not len(own['motion']):
            return Verdict(False, 'no motion in one half of the recording: the estimators use the '
                                  'noise in motion')
        for phase, values in other.items():
            gain = math.log(configured / identified) + 0.5 * values ** 2 * (
                configured ** -2 - identified ** -2)
            count = EFFECTIVE_SHARE * _window_samples(parts[0])
            if len(values) and count * np.sum(gain) < MIN_LIKELIHOOD_GAIN:
                return Verdict(False, (
                    f'no improvement on the other half: {identified:.3g} {unit} at standstill, '
                    f'configured {configured:.3g} {unit}, while the other half has '
                    f'{np.median(values):.3g} {unit} in {phase}'))
    return Verdict(True, 'likelihood of the other half, at standstill and in motion')


def _window_samples(recording: Recording) -> float:
    return NOISE_WINDOW / float(np.median(np.diff(recording.imu.time)))


def _noise_levels(half: Recording, signal: Array) -> dict[str, Array]:
    """Return the noise levels of windows at standstill and in motion."""
    levels: dict[str, list[float]] = {'standstill': [], 'motion': []}
    time, speed = half.wheels.time, np.abs(half.wheels.velocity).max(axis=1)
    period = float(np.median(np.diff(time)))
    for begin in np.arange(time[0], time[-1] - NOISE_WINDOW, NOISE_WINDOW):
        seen = (time >= begin) & (time < begin + NOISE_WINDOW)
        inside = (half.imu.time >= begin) & (half.imu.time < begin + NOISE_WINDOW)
        if np.sum(seen) * period < 0.8 * NOISE_WINDOW or np.sum(inside) < MIN_WINDOW_SAMPLES:
            continue
        rows = signal[inside]
        fresh = np.append(True, (np.diff(rows, axis=0) != 0.0).any(axis=1))  # not repeated
        level = math.sqrt(float(np.mean([noise_level(column) ** 2 for column in rows[fresh].T])))
        if level > 0.0:
            moving = speed[seen].max() > STATIONARY_SPEED
            levels['motion' if moving else 'standstill'].append(level)
    return {phase: np.array(values) for phase, values in levels.items()}


def value_verdict(values: Sequence[float], configured: float, sigmas: Sequence[float],
                  unit: str) -> Verdict:
    """
    Return whether the value of each half is closer to that of the other half than ``configured``.

    For values whose measurements are not kept: the distance in standard errors is the increase of
    their cost.
    """
    (first, second), sigma = values, math.hypot(*sigmas)
    text = (f'the halves give {first:.4g} and {second:.4g} {unit}, configured {configured:.4g} '
            f'{unit}')
    distance = min(abs(configured - first), abs(configured - second))
    if abs(first - second) >= distance:
        return Verdict(False, f'no improvement on the other half: {text}')
    if distance < MIN_IMPROVEMENT_SIGMAS * 0.5 * sigma:
        return Verdict(False, f'no significant improvement on the other half: {text}')
    return Verdict(True, text)
