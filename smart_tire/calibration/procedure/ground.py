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

"""Whether straight driving was on one ground, with rolling wheels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.calibration.recording import Recording
from smart_tire.calibration.results import CONTRADICTION_SIGMAS
from smart_tire.calibration.tire.stiffness import identify_stiffness, StiffnessFit
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.samples import GRAVITY
from smart_tire.uncertain import Uncertain

MIN_PART = 12.0         # s
STANDSTILL_SPEED = 0.02    # rad/s, of stationary wheels
MAX_SLIDING_SHARE = 0.3    # of the time in motion, beyond the critical slip


def check_one_ground(recordings: Sequence[Recording], robot: RobotParams,
                     latency_sigma: float) -> None:
    """
    Raise EstimatorError if C_x or drag of the parts of ``recordings`` differ significantly.

    The parts of a recording are its halves, divided at a standstill.
    """
    fits = []
    for part in (part for recording in recordings for part in parts_of(recording)):
        try:
            fits.append(identify_stiffness([part], robot, latency_sigma))
        except EstimatorError:
            continue  # too little for a value of its own, which the whole may have
    for name, unit in (('stiffness', 'C_x'), ('drag', 'drag')):
        values = [getattr(fit, name) for fit in fits]
        if any(differ(first, second) for i, first in enumerate(values) for second in values[:i]):
            text = ', '.join(f'{value.value:.3g} ± {value.sigma:.2g}' for value in values)
            raise EstimatorError(f'the parts of the recordings give {unit} {text} N: several '
                                 'grounds in one recording, give the part on one ground')


def differ(first: Uncertain, second: Uncertain) -> bool:
    """Return whether two values differ significantly."""
    return abs(first.value - second.value) > CONTRADICTION_SIGMAS * math.hypot(
        first.sigma, second.sigma)


def parts_of(recording: Recording) -> list[Recording]:
    """Return the halves of a recording, divided at the standstill next to its middle."""
    wheels = recording.wheels
    if np.ptp(wheels.time) < 2.0 * MIN_PART:
        return []
    still = wheels.time[np.abs(wheels.velocity).max(axis=1) < STANDSTILL_SPEED]
    middle = 0.5 * float(wheels.time[0] + wheels.time[-1])
    if not len(still):
        return []
    cut = float(still[np.argmin(np.abs(still - middle))])
    if min(cut - wheels.time[0], wheels.time[-1] - cut) < 0.5 * MIN_PART:
        return []
    return [_between(recording, -math.inf, cut), _between(recording, cut, math.inf)]


def _between(recording: Recording, begin: float, end: float) -> Recording:
    imu, wheels = recording.imu, recording.wheels
    return replace(recording, imu=imu.where((imu.time >= begin) & (imu.time <= end)),
                   wheels=wheels.where((wheels.time >= begin) & (wheels.time <= end)))


def check_rolling(fit: StiffnessFit, robot: RobotParams) -> None:
    """Raise EstimatorError if the wheels slide in much of the straight motion."""
    load = 0.25 * robot.mass * GRAVITY
    critical = 3.0 * fit.friction.value * load / fit.stiffness.value
    moving = np.abs(fit.force) > 0.0
    share = float(np.mean(np.abs(fit.slip[moving]) > critical)) if moving.any() else 0.0
    if share > MAX_SLIDING_SHARE:
        raise EstimatorError(f'the wheels slide in {share:.0%} of the motion, expected at most '
                             f'{MAX_SLIDING_SHARE:.0%}: accelerate less')
