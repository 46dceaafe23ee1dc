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
Longitudinal stiffness C_x in the fit of all windows, and the reasons that it is refused for.

The stiffness is proportional to the configured mass; it is that of the tire-ground pair.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.ground_fit import Equations, GroundFit, SCALE
from smart_tire.calibration.motor_rows import MAX_SLIP
from smart_tire.calibration.recording import MAX_TURN_SHARE
from smart_tire.calibration.results import CONTRADICTION_SIGMAS, differ, Found, MIN_ROBUST
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground import body_model as model
from smart_tire.estimation.ground.measurements import FORCE_X
from smart_tire.estimation.ground.unknowns import Unknown
from smart_tire.estimation.ground.wheel_motion import block_means
from smart_tire.estimation.slip.state import MIN_SLIP_SPEED
from smart_tire.models.tire.brush_tire import critical_slip
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import GRAVITY
from smart_tire.uncertain import MAX_RELATIVE_SIGMA, Uncertain

MAX_SLIDING_SHARE = 0.3  # of straight motion, beyond the critical slip
MAX_NOISE_SHARE = 0.08   # of accelerations; more noise makes a tire seem too stiff


@dataclass(frozen=True, kw_only=True)
class StiffnessFit:
    """Stiffness, with the data of its figure."""

    fit: GroundFit
    stiffness: Uncertain        # N, C_x of one wheel
    slip: Array                 # (n,) -, of the wheels against the fitted speed of the body
    force: Array                # (n,) N, of one wheel, positive when driving, as measured
    curve: tuple[Array, Array]  # slip [-] and force [N] of one wheel as fitted

    def report(self) -> Found:
        """Return what is printed."""
        found, fit = Found(), self.fit
        scale = fit.estimate(SCALE)
        for name, value, unit, note in (
                ('stiffness', self.stiffness, 'N', 'C_x of one wheel, proportional to the mass'),
                ('rolling resistance', fit.positive(Unknown.RESISTANCE), '-', 'not written'),
                ('friction', fit.positive(Unknown.FRICTION), '-',
                 'from the curvature over slip, not written'),
                ('latency', fit.latency, 's', 'of the wheels, not written'),
                ('acceleration', Uncertain(1.0 + scale.value, scale.sigma), '-',
                 'measured over true: scale, and pitching of the body; not written')):
            found.add(name, value, unit, note)
        return found

    def parameters(self) -> list[Identified]:
        """Return the entries of a parameter file."""
        value, sigma = self.stiffness
        return [Identified('tire.longitudinal_stiffness', value, sigma,
                           f'for a mass of {self.fit.robot.mass:g} kg, on the recorded ground'),
                Identified('tire.longitudinal_stiffness_sigma', sigma / value,
                           note='relative standard error of C_x on that ground')]


def stiffness_of(fit: GroundFit) -> StiffnessFit:
    """Return the stiffness in a fit; raise EstimatorError with the reason if not observable."""
    rows = np.concatenate([_straight(one, fit) for one in fit.windows])
    if len(rows) < MIN_ROBUST:
        raise EstimatorError(f'{len(rows)} intervals of straight motion above '
                             f'{MIN_SLIP_SPEED:g} m/s, expected {MIN_ROBUST}')
    slip, force, fitted, sliding = rows.T
    count = np.median(np.concatenate([one.measurements.imu_count for one in fit.windows]))
    share = fit.noise / math.sqrt(count) / max(float(np.std(4.0 * force / fit.robot.mass)), 1e-9)
    if share > MAX_NOISE_SHARE:
        raise EstimatorError(
            f'the accelerometer noise in motion is {share:.0%} of the accelerations, expected at '
            f'most {MAX_NOISE_SHARE:.0%}: speed changes too little, or the robot vibrates')
    _check_one_ground(fit)
    name, size = fit.tension
    if size > CONTRADICTION_SIGMAS:
        raise EstimatorError(f'{name} would be {size:.1f} standard deviations from what is known: '
                             'wheels slide, the ground changes, or the axes of the IMU are wrong')
    stiffness = fit.positive(Unknown.STIFFNESS)
    if not stiffness.determined:
        raise EstimatorError(
            f'standard error of {stiffness.sigma / stiffness.value:.0%}, expected at most '
            f'{MAX_RELATIVE_SIGMA:.0%}: speed changes too little on straight lines, below '
            'critical slip, or the axes of the IMU are wrong')
    if np.mean(sliding) > MAX_SLIDING_SHARE:
        raise EstimatorError(f'the wheels slide in {np.mean(sliding):.0%} of the motion, expected '
                             f'at most {MAX_SLIDING_SHARE:.0%}: accelerate less')
    order = np.argsort(slip)
    return StiffnessFit(fit=fit, stiffness=stiffness, slip=slip, force=force,
                        curve=(slip[order], fitted[order]))


def _straight(one: Equations, fit: GroundFit) -> Array:
    """
    Return the straight motion of a window, by blocks, as rows (n, 4).

    Slip, force of one wheel as measured and as fitted [N], and whether the wheels slide.
    """
    measurements, robot = one.measurements, fit.robot
    states = one.fit.motion.means[:, 0].T  # of the first run
    rolling = block_means(measurements.rolling) * math.exp(one.fit.x[Unknown.RADIUS])
    speed = rolling.mean(axis=1)
    turn = 0.5 * np.abs(rolling[:, 1::2].mean(axis=1) - rolling[:, ::2].mean(axis=1))
    used = (measurements.used & (np.abs(speed) > MIN_SLIP_SPEED)
            & (turn < MAX_TURN_SHARE * np.abs(speed)))
    tread, loads = (states[:, first:first + 4] for first in (model.FORCE, model.LOADS))
    fitted = tread.mean(axis=1)
    predicted = measurements.predict(one.fit.x[np.newaxis], one.fit.motion)[0, FORCE_X]
    # what the accelerometer measures in addition to the fit is a force, too
    force = fitted + 0.25 * robot.mass * (measurements.values[FORCE_X] - predicted)
    direction = np.sign(speed)
    slip = (speed - states[:, model.U]) / np.where(used, np.abs(speed), 1.0)
    critical = critical_slip(math.exp(one.fit.x[Unknown.FRICTION]), loads.mean(axis=1),
                             math.exp(one.fit.x[Unknown.STIFFNESS]))
    return np.column_stack([direction * slip, direction * force, direction * fitted,
                            np.abs(slip) > np.minimum(critical, MAX_SLIP)])[used]


def _check_one_ground(fit: GroundFit) -> None:
    """Raise EstimatorError if C_x or drag of the parts of the recordings differ significantly."""
    for name, row, nominal in (('C_x', Unknown.STIFFNESS, 1.0),
                               ('drag', Unknown.RESISTANCE, fit.robot.mass * GRAVITY)):
        values = [part[row] for part in fit.grounds]
        if any(differ(first, second) for i, first in enumerate(values) for second in values[:i]):
            text = ', '.join(f'{nominal * math.exp(one.value):.3g} ± '
                             f'{nominal * math.exp(one.value) * one.sigma:.2g}' for one in values)
            raise EstimatorError(f'the parts of the recordings give {name} {text} N: they are not '
                                 'of one tire on one ground: several grounds in one recording')
