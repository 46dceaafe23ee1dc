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
Effective track from whole turns: rolled difference of the sides over the change of yaw.

In the steady part of a turn neither latency nor the lag of the body matters, so each turn gives a
value whose error is that of gyro and encoders. The track depends on the ground: values that differ
by much more than their errors are those of several grounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import period, Recording, Signal
from smart_tire.calibration.robot.icr import turns_of
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.samples import LEFT, RIGHT
from smart_tire.uncertain import Uncertain

SETTLING = 0.7          # s of a turn before it is steady, and before it ends
MIN_YAW = 1.0           # rad of yaw in the steady part of a turn
MIN_TURNS = 2           # in each direction
MAX_GROUND_SPREAD = 0.1  # relative, between turns: tires on other ground
MAX_TRACK_SIGMA = 0.05  # relative standard error above which a track is refused


@dataclass(frozen=True)
class TurnTrack:
    """Effective track, and that of each turn."""

    track: Uncertain  # m, for the configured wheel_radius
    turns: Array      # (n,) m
    spread: float     # m, standard deviation between turns


@dataclass(frozen=True)
class _Turn:
    duration: float  # s
    yaw: float       # rad, without gyro bias
    rolled: float    # m, right minus left
    sigma: float     # m, of rolled - track * yaw, without gyro bias


def fit_turn_track(recordings: Sequence[Recording], robot: RobotParams,
                   gyro_bias: Uncertain) -> TurnTrack:
    """
    Return the effective track of the turns in ``recordings``, all with the same ``gyro_bias``.

    Raises EstimatorError without turns in both directions, or if their tracks are those of
    several grounds.
    """
    turns = [turn for recording in recordings for turn in _steady(recording, robot, gyro_bias)]
    left, right = (sum(turn.yaw * sign > 0.0 for turn in turns) for sign in (1.0, -1.0))
    if min(left, right) < 1 or len(turns) < MIN_TURNS:
        raise EstimatorError(f'{left} steady turns to the left and {right} to the right of '
                             f'{MIN_YAW:g} rad or more, expected at least one each')
    track = _fit(turns, robot, gyro_bias.sigma)
    tracks = np.array([turn.rolled / turn.yaw for turn in turns])
    spread = float(np.std(tracks, ddof=1))
    _check(tracks, spread, track)
    return TurnTrack(Uncertain(track.value, math.hypot(
        track.sigma, spread / math.sqrt(len(turns)))), tracks, spread)


def _check(tracks: Array, spread: float, track: Uncertain) -> None:
    if not track.value > 0.0:
        raise EstimatorError('the yaw rate does not follow the wheel difference: are left and '
                             'right swapped?')
    if spread > MAX_GROUND_SPREAD * track.value:
        values = ', '.join(f'{value:.2f}' for value in tracks)
        raise EstimatorError(f'the turns give {values} m: several grounds in one recording')
    if track.sigma > MAX_TRACK_SIGMA * track.value:
        raise EstimatorError(f'standard error of {track.sigma / track.value:.0%}, expected at '
                             f'most {MAX_TRACK_SIGMA:.0%}')


def _steady(recording: Recording, robot: RobotParams, gyro_bias: Uncertain) -> list[_Turn]:
    """Return the turns of a recording with enough yaw in their steady part."""
    imu, wheels, found = recording.imu, recording.wheels, []
    gyro = Signal(imu.time, imu.rate[:, 2] - gyro_bias.value)
    difference = _difference(recording, robot)
    for begin, end in turns_of(recording):
        inside = (wheels.time > begin + SETTLING) & (wheels.time < end - SETTLING)
        first, last = np.flatnonzero(inside)[[0, -1]] if inside.sum() > 1 else (0, 0)
        duration = float(wheels.time[last] - wheels.time[first])
        times = np.array([wheels.time[first], wheels.time[last]]) - robot.encoder.latency
        yaw = float(np.diff(gyro.integral(times))[0])
        if duration <= 0.0 or abs(yaw) < MIN_YAW:
            continue
        rolled = float(difference[last] - difference[first])
        track = rolled / yaw
        noise = robot.imu.gyro_noise * math.sqrt(duration * period(imu.time))  # rad
        late = math.sqrt(2.0) * robot.encoder.stamp_jitter / duration          # relative
        count = math.tau / robot.encoder.counts_per_revolution * robot.wheel_radius
        found.append(_Turn(duration, yaw, rolled, math.hypot(
            track * noise, rolled * late, count)))
    return found


def _difference(recording: Recording, robot: RobotParams) -> Array:
    """Return the rolled distance [m] (n,) of the right wheels minus that of the left ones."""
    wheels = recording.wheels
    angle = wheels.position if wheels.position is not None else np.concatenate([
        np.zeros((1, 4)), np.cumsum(wheels.velocity[1:] * np.diff(wheels.time)[:, None], axis=0)])
    return np.asarray(robot.wheel_radius * (angle[:, RIGHT].mean(axis=1)
                                            - angle[:, LEFT].mean(axis=1)))


def _fit(turns: Sequence[_Turn], robot: RobotParams, bias_sigma: float) -> Uncertain:
    """Return the track of all turns; the error of the gyro bias is common to them."""
    weight = np.array([1.0 / turn.sigma for turn in turns])
    yaw, rolled, duration = (np.array([getattr(turn, name) for turn in turns])
                             for name in ('yaw', 'rolled', 'duration'))
    rough = float(np.sum(np.abs(rolled)) / np.sum(np.abs(yaw)))
    rows = np.vstack([np.column_stack([yaw, rough * duration]) * weight[:, None],
                      [0.0, 1.0 / max(bias_sigma, 1e-9)]])
    target = np.append(rolled * weight, 0.0)
    covariance = np.linalg.inv(rows.T @ rows)
    return Uncertain(float((covariance @ rows.T @ target)[0]), math.sqrt(float(covariance[0, 0])))
