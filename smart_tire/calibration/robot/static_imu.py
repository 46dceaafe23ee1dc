"""
What an inertial unit reads at rest: noise, bias of the gyro, and the tilt of its mounting.

Rest is where the wheels stand and the unit is as quiet as it ever is: the robot may settle after
a stop, or be pushed. On level ground tilt and the bias of the accelerometer look the same, and the
slope of the ground does where the robot always stands alike: the tilt's standard error has both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import ImuRecord, Recording, WheelRecord
from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.zero_velocity import NOISE_FACTOR, SETTLED, STILL_WHEEL
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain


BEFORE_MOTION = 0.5  # s before the wheels are seen to move: they may be late
WINDOW = 1.0         # s over which noise is taken
FEW = 3              # readings in a window
SLOPE = 0.01         # rad, one sigma of the ground's slope where too few rests tell; assumed
ENOUGH = 3           # rests that tell the spread of the slopes
HELD = 0.05          # share of readings that repeat the one before: more is no chance
QUIETER = 0.1        # of the windows that are taken for quiet beforehand


@dataclass(frozen=True)
class RestFit:
    """What rest tells; axes are those of ``base_link``, as far as the mounting is known."""

    seconds: float             # of rest
    places: int                # rests with motion between them
    gyro_bias: list[Uncertain]  # rad/s, about x, y, z
    roll: Uncertain             # rad, of the mounting beyond what the parameters say
    pitch: Uncertain            # rad
    gyro_noise: Uncertain       # rad/s, of a reading about z
    accel_noise: Uncertain      # m/s2, of a reading along x and y
    repeated: float            # share of readings that only repeat the one before


@dataclass(frozen=True)
class _Window:
    place: int    # count of the rest
    rate: Array   # (n, 3)
    force: Array  # (n, 3)


def fit_rest(recording: Recording, robot: RobotParams) -> RestFit:
    """Return what the rests of a recording tell; raise EstimatorError where there are none."""
    imu = recording.imu
    fresh = np.append(True, (np.diff(imu.rate, axis=0) != 0.0).any(axis=1)
                      | (np.diff(imu.force, axis=0) != 0.0).any(axis=1))
    still = STILL_WHEEL / robot.wheel_radius
    windows = _quiet(list(_windows(imu, fresh, rests(recording.wheels, still))))
    if not windows:
        raise EstimatorError('the robot never stands still for '
                             f'{SETTLED + WINDOW + BEFORE_MOTION:g} s')
    gyro, accel = _noise(windows, 'rate', [2]), _noise(windows, 'force', [0, 1])
    places = sorted({window.place for window in windows})
    tilts = np.array([_tilt(_mean(windows, 'force', place)) for place in places])
    slope = float(tilts.std(axis=0, ddof=1).max()) if len(places) >= ENOUGH else SLOPE
    sigma = math.hypot(robot.imu.accel_bias / GRAVITY, slope / math.sqrt(len(places)))
    roll, pitch = (Uncertain(float(value), sigma) for value in tilts.mean(axis=0))
    return RestFit(WINDOW * len(windows), len(places), _biases(windows, places), roll, pitch,
                   gyro, accel, float(1.0 - fresh.mean()))


def rests(wheels: WheelRecord, still: float) -> Iterator[tuple[float, float]]:
    """Yield begin and end [s] of times in which no wheel is faster than ``still`` [rad/s]."""
    quiet = np.append(np.abs(wheels.velocity).max(axis=1) < still, False)
    begin: float | None = None
    for index, calm in enumerate(quiet.tolist()):
        if calm and begin is None:
            begin = float(wheels.time[index])
        elif not calm and begin is not None:
            yield begin, float(wheels.time[index - 1])
            begin = None


def _windows(imu: ImuRecord, fresh: NDArray[np.bool_],
             times: Iterator[tuple[float, float]]) -> Iterator[_Window]:
    """Yield the readings of each second at rest, without those that only repeat."""
    for place, (begin, end) in enumerate(times):
        begin += SETTLED if place else 0.0  # a run that begins at rest has no stop to settle from
        count = int((end - begin - BEFORE_MOTION) / WINDOW)
        for first in begin + WINDOW * np.arange(max(count, 0)):
            chosen = fresh & (imu.time >= first) & (imu.time < first + WINDOW)
            if chosen.sum() >= FEW:
                yield _Window(place, imu.rate[chosen], imu.force[chosen])


def _quiet(windows: list[_Window]) -> list[_Window]:
    """Return the windows that are about as quiet as the quietest."""
    if not windows:
        return []
    spread = np.array([[*w.rate.std(axis=0), *w.force.std(axis=0)] for w in windows])
    limit = NOISE_FACTOR * np.maximum(np.quantile(spread, QUIETER, axis=0), 1e-9)
    return [window for window, calm in zip(windows, (spread <= limit).all(axis=1)) if calm]


def _noise(windows: list[_Window], name: str, axes: list[int]) -> Uncertain:
    """Return the standard deviation of a reading along ``axes``."""
    values = [getattr(window, name)[:, axes] for window in windows]
    freedom = sum(value.size - len(axes) for value in values)
    squares = sum(float(np.sum((value - value.mean(axis=0)) ** 2)) for value in values)
    noise = math.sqrt(squares / freedom)
    return Uncertain(noise, noise / math.sqrt(2.0 * freedom))


def _mean(windows: list[_Window], name: str, place: int) -> Array:
    return np.mean([getattr(window, name).mean(axis=0) for window in windows
                    if window.place == place], axis=0)


def _biases(windows: list[_Window], places: list[int]) -> list[Uncertain]:
    """Return the gyro's biases; their errors have noise and what changes from rest to rest."""
    means = np.array([window.rate.mean(axis=0) for window in windows])
    count = sum(len(window.rate) for window in windows)
    noise = np.array([_noise(windows, 'rate', [axis]).value for axis in range(3)])
    error = np.maximum(noise / math.sqrt(count), means.std(axis=0, ddof=min(1, len(means) - 1))
                       / math.sqrt(len(means)))
    if len(places) >= ENOUGH:
        rested = np.array([_mean(windows, 'rate', place) for place in places])
        error = np.maximum(error, rested.std(axis=0, ddof=1) / math.sqrt(len(places)))
    return [Uncertain(float(mean), float(sigma)) for mean, sigma in zip(means.mean(axis=0), error)]


def _tilt(force: Array) -> tuple[float, float]:
    """Return roll and pitch [rad] of the unit that feels ``force`` (3,) at rest."""
    x, y, z = (force / np.linalg.norm(force)).tolist()
    return math.atan2(y, z), -math.asin(x)
