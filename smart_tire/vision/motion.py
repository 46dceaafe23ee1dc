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
Motion and wheel slip of the robot from its poses in images.

Yaw is smoothed first; position and velocity in ``base_link`` are then linear in each other. The
wheel angles are smoothed in the same way, and slip is B(3) with the velocities of both. The time
by which the stamps of images are late is that which fits the yaw of the images to the gyroscope,
or to the wheels. It and the calibration have errors that all images share: they are added to the
covariance of what they change.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.errors import EstimatorError
from smart_tire.models.vehicle.skid_steer import SIDE_SIGNS, slip_ratio, wheel_velocities
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.rotation import quaternion
from smart_tire.samples import (
    four, ImuSample, LEFT, NS_PER_S, Odometry, RIGHT, WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain
from smart_tire.vision.localization import Fix, turn
from smart_tire.vision.smoothing import ROUNDS, smooth, Track

MAX_GAP = 0.5             # s between two images, over which a turn would be ambiguous
MIN_IMAGES = 5            # between two gaps; fewer do not determine a velocity
MAX_ACCELERATION = 50.0   # m/s2, of a robot between three images; beyond, one of them is wrong
MAX_OFFSET = 0.4          # s, of the search
OFFSET_STEP = 0.02        # s
OFFSET_PRIOR = 0.05       # s, standard deviation where nothing shows it: latency of USB cameras
LAG_SHARE = 0.5           # of the lag of the body behind the wheels, its standard deviation: C_x
WHEEL_SCALE = (0.7, 0.5)  # -, prior of the yaw rate over that of wheels without slip
GYRO_SCALE = 0.02         # -, standard deviation of the scale of a gyroscope
ICR_SHARES = (0.05, 0.2)  # of the wheelbase: v_x and v_y over the yaw rate, B(8); as icr_x_sigma
MIN_ANGLE_SIGMA = 1e-5    # rad, of a wheel
MIN_NOISE = 0.01          # pixels, of a corner
PLANAR_VARIANCE = 1e-6    # m^2, rad^2 and per s: what the plane excludes, as in odom

JUMP = 'pose jumps against the images before and after'
ISOLATED = f'fewer than {MIN_IMAGES} images between gaps'


@dataclass(frozen=True)
class CameraMotion:
    """Planar motion of ``base_link`` at the instants of n images, their time offset removed."""

    stamp_ns: tuple[int, ...]
    pose: Array        # (n, 3) m, m, rad: x, y, yaw in map
    twist: Array       # (n, 3) m/s, m/s, rad/s: v_x, v_y, yaw rate in base_link
    pose_covariance: Array   # (n, 3, 3)
    twist_covariance: Array  # (n, 3, 3)
    noise: float       # factor of the pixel noise that the scatter of the poses shows

    @property
    def map_rates(self) -> Array:
        """Return the rates of the pose (n, 3) in map."""
        velocity = np.einsum('kij,kj->ki', turn(self.pose[:, 2]), self.twist[:, :2])
        return np.column_stack([velocity, self.twist[:, 2]])

    def odometry(self, height: float) -> list[Odometry]:
        """Return the samples; ``height`` [m] is that of ``base_link`` above the floor."""
        return [Odometry(stamp_ns, (*pose[:2].tolist(), height), quaternion(0.0, 0.0, pose[2]),
                         (*twist[:2].tolist(), 0.0), (0.0, 0.0, float(twist[2])), *(
                             _six(one) for one in spreads))
                for stamp_ns, pose, twist, *spreads in zip(
                    self.stamp_ns, self.pose, self.twist, self.pose_covariance,
                    self.twist_covariance)]


def pixel_noise(fixes: Sequence[Fix]) -> float:
    """
    Return the standard deviation [pixels] of the coordinate of a corner, from the residuals.

    It is robust against up to half outliers: the median square over that of chi-square.
    """
    from scipy.special import chdtri  # at first use: takes a part of a second
    median = np.median([fix.squares / chdtri(fix.freedom, 0.5) for fix in fixes])
    return max(math.sqrt(median), MIN_NOISE)


def used(fixes: Sequence[Fix], noise: float, refused: Counter[str]) -> list[list[Fix]]:
    """
    Return the fixes that agree with ``noise`` [pixels] and with their neighbors, cut at gaps.

    Counts the others in ``refused``, by reason.
    """
    refused.update(fix.reason for fix in fixes if not fix.fits(noise))
    parts: list[list[Fix]] = []
    for fix in _without_jumps([fix for fix in fixes if fix.fits(noise)], refused):
        if not parts or fix.stamp_ns - parts[-1][-1].stamp_ns > MAX_GAP * NS_PER_S:
            parts.append([])
        parts[-1].append(fix)
    if isolated := sum(len(part) for part in parts if len(part) < MIN_IMAGES):
        refused[ISOLATED] += isolated
    return [part for part in parts if len(part) >= MIN_IMAGES]


def _without_jumps(fixes: list[Fix], refused: Counter[str]) -> list[Fix]:
    """Return the fixes but those that are further from both neighbors than a robot can drive."""
    while len(fixes) > 2:
        time = np.array([fix.stamp_ns for fix in fixes]) / NS_PER_S
        place = np.array([fix.pose[:2] for fix in fixes])
        step, share = time[2:] - time[:-2], ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))
        chord = place[:-2] + share[:, None] * (place[2:] - place[:-2])
        excess = np.linalg.norm(place[1:-1] - chord, axis=1) / np.maximum(
            0.5 * MAX_ACCELERATION * (share * (1.0 - share) * step ** 2), 1e-9)
        worst = int(np.argmax(excess))
        if excess[worst] <= 1.0:
            break
        refused[JUMP] += 1
        fixes = fixes[:worst + 1] + fixes[worst + 2:]
    return fixes


def motion_of(fixes: Sequence[Fix], noise: float, offset: Uncertain, robot: RobotParams,
              rounds: int = ROUNDS) -> CameraMotion:
    """
    Return the smoothed motion from consecutive fixes without gaps.

    ``noise`` [pixels] is that of the corners; ``offset`` [s] is by how much the stamps are late.
    A turn changes the lateral velocity, B(8).
    """
    stamps = [fix.stamp_ns - round(offset.value * NS_PER_S) for fix in fixes]
    time = np.array([stamp - stamps[0] for stamp in stamps]) / NS_PER_S
    poses = np.array([fix.pose for fix in fixes])
    spread = np.array([fix.variance(noise) * fix.shape for fix in fixes])
    yaw = smooth(time, np.unwrap(poses[:, 2:], axis=0), spread[:, 2:, 2:], rounds=rounds)
    middle = 0.5 * (yaw.values[1:, 0] + yaw.values[:-1, 0])
    place = smooth(time, poses[:, :2], spread[:, :2, :2], turn(middle),
                   yaw.density * (np.array(ICR_SHARES) * robot.wheelbase) ** 2, rounds)
    twist = np.column_stack([place.rates, yaw.rates])
    pose = np.column_stack([place.values, yaw.values])
    covariances = np.zeros((2, len(fixes), 3, 3))
    for one, part in enumerate((slice(0, 2), slice(2, 4))):
        covariances[one, :, :2, :2] = place.covariances[:, part, part]
    covariances[:, :, 2, 2] = yaw.covariances[:, 0, 0], yaw.covariances[:, 1, 1]
    # An error of the yaw turns the velocity in base_link; that of a tag in steady motion, in the
    # edge of a shadow for example, is common to many images.
    across = np.column_stack([twist[:, 1], -twist[:, 0], np.zeros(len(fixes))])
    covariances[1] += (spread[:, 2:, 2:] + yaw.covariances[:, :1, :1]) * _outer(across)
    found = CameraMotion(tuple(stamps), pose, twist, covariances[0], covariances[1],
                         math.sqrt((2.0 * place.noise ** 2 + yaw.noise ** 2) / 3.0))
    # the errors of a tag at rest are the same in all images: they have no mean that vanishes
    found.pose_covariance[:] += spread + np.array([fix.calibration for fix in fixes]) + (
        offset.sigma ** 2 * _outer(found.map_rates))
    found.twist_covariance[:] += offset.sigma ** 2 * _outer(np.gradient(twist, time, axis=0))
    return found


def row_time(parts: Sequence[Sequence[Fix]], motions: Sequence[CameraMotion], noise: float
             ) -> Uncertain:
    """
    Return the time [s] between two rows of a rolling shutter, from the shear of moving tags.

    ``noise`` [pixels] is that of the corners.
    """
    products = squares = 0.0
    for part, motion in zip(parts, motions):
        for fix, rates in zip(part, motion.map_rates):
            shear, _ = fix.row_shift(rates)
            products += float(shear @ fix.residual)
            squares += float(shear @ shear)
    if not squares:
        return Uncertain(0.0, math.inf)
    return Uncertain(products / squares, noise / math.sqrt(squares))


def unrolled(part: Sequence[Fix], motion: CameraMotion, line: float) -> list[Fix]:
    """Return the fixes as if all rows were seen with the middle one; ``line`` [s] is per row."""
    found = []
    for fix, rates in zip(part, motion.map_rates):
        shear, pose = fix.row_shift(rates)
        residual = fix.residual - line * shear
        found.append(replace(fix, pose=fix.pose - line * pose, residual=residual,
                             squares=float(residual @ residual)))
    return found


def wheel_tracks(wheels: SampleArrays, robot: RobotParams, rounds: int = ROUNDS
                 ) -> list[tuple[int, Track] | None]:
    """
    Return the smoothed angles [rad] of the wheels: first stamp [ns] and a track per wheel.

    None for a wheel without encoder, or with fewer than three samples.
    """
    stream, encoder = wheels.stream(WheelSample).ordered, robot.encoder
    stamps = stream.stamp_ns - round(encoder.latency * NS_PER_S)
    time, speeds = (stamps - stamps[:1]) / NS_PER_S, stream['velocity']
    driven = np.vstack([np.zeros((1, 4)), np.cumsum(
        speeds[1:] * np.diff(time)[:, None], axis=0)])
    angles = np.where(np.isnan(stream['position']).all(0), driven, stream['position'])
    step = math.tau / encoder.counts_per_revolution
    variances = step ** 2 / 6.0 + (speeds * encoder.stamp_jitter) ** 2 + MIN_ANGLE_SIGMA ** 2
    known = np.isfinite(angles) & np.isfinite(speeds)
    return [(int(stamps[0]), smooth(time[rows], angle[rows, None], variance[rows, None, None],
                                    rounds=rounds)) if rows.sum() > 2 else None
            for rows, angle, variance in zip(known.T, angles.T, variances.T)]


def slips_of(motion: CameraMotion, tracks: Sequence[tuple[int, Track] | None],
             robot: RobotParams) -> list[WheelSlip]:
    """Return the slip of the wheels at the instants of ``motion`` that have wheel samples."""
    speed, variance = np.full((2, len(motion.stamp_ns), 4), np.nan)
    for i, one in enumerate(tracks):
        if one is not None:
            first_ns, track = one
            rates, spread = track.rates_at(
                np.array([stamp - first_ns for stamp in motion.stamp_ns]) / NS_PER_S, MAX_GAP)
            speed[:, i] = robot.wheel_radius * rates[:, 0]
            variance[:, i] = robot.wheel_radius ** 2 * spread[:, 0]
    v_x, _ = wheel_velocities(motion.twist[:, 0], motion.twist[:, 1], motion.twist[:, 2],
                              robot.wheelbase, robot.track_width)
    lever = np.stack([np.ones(4), np.zeros(4), -0.5 * robot.track_width * SIDE_SIGNS], -1)
    ground = np.einsum('wi,kij,wj->kw', lever, motion.twist_covariance, lever)
    ratio = slip_ratio(speed, v_x, robot.slip.standstill_speed)
    with np.errstate(divide='ignore', invalid='ignore'):
        rolled = variance + (robot.wheel_radius_sigma * speed) ** 2
        sigma = np.sqrt(ground + (v_x / speed) ** 2 * rolled) / np.abs(speed)
    sigma = np.where(np.isnan(ratio), 1.0, np.minimum(np.nan_to_num(sigma, nan=1.0), 1.0))
    return [WheelSlip(stamp_ns, *(four(row.tolist()) for row in rows)) for stamp_ns, near, *rows
            in zip(motion.stamp_ns, np.isfinite(speed).any(1), ratio, speed - v_x, sigma) if near]


def time_offset(parts: Sequence[Sequence[Fix]], inputs: SampleArrays, robot: RobotParams
                ) -> tuple[Uncertain, str]:
    """
    Return by how much [s] the stamps of images are late, and how it was estimated.

    Where neither gyroscope nor wheels show a unique time, it is 0 with ``OFFSET_PRIOR``.
    """
    from smart_tire.numerics.delay import fit_delay
    from smart_tire.numerics.least_squares import Prior, Rows
    reference = _turning(inputs, robot)
    if reference is None:
        return (Uncertain(0.0, OFFSET_PRIOR),
                'not estimated (neither imu/data nor wheel_states), 0 assumed')
    stamps, angle, scale, lag = reference
    origin = int(stamps[0])
    known_at = (stamps - origin) / NS_PER_S
    pairs = [(one, other) for part in parts for one, other in zip(part, part[1:])]
    begin, end = (np.array([pair[i].stamp_ns - origin for pair in pairs]) / NS_PER_S
                  for i in range(2))
    turned = np.array([math.remainder(b.pose[2] - a.pose[2], math.tau) for a, b in pairs])
    inside = (begin - MAX_OFFSET > known_at[0]) & (end + MAX_OFFSET < known_at[-1])
    begin, end, turned = begin[inside], end[inside], turned[inside]

    def rows(delay: float) -> Rows:
        known = np.interp(end - delay, known_at, angle) - np.interp(
            begin - delay, known_at, angle)
        return Rows(0.5 * (begin + end), np.column_stack([known, end - begin]), turned,
                    np.zeros(len(turned)))
    try:
        fit = fit_delay(rows, Prior.of(scale, (0.0, 1.0)), np.arange(
            -MAX_OFFSET, MAX_OFFSET + 0.5 * OFFSET_STEP, OFFSET_STEP), overlapping=True)
    except EstimatorError as error:
        return Uncertain(0.0, OFFSET_PRIOR), f'not estimated ({error}), 0 assumed'
    value, sigma = fit.estimate(-1)
    value, sigma = value - lag, math.hypot(sigma, LAG_SHARE * lag)
    if not sigma < OFFSET_PRIOR:
        return Uncertain(0.0, OFFSET_PRIOR), 'not estimated (the robot hardly turns), 0 assumed'
    return Uncertain(value, sigma), 'from ' + ('wheel_states' if lag else 'imu/data')


def _turning(inputs: SampleArrays, robot: RobotParams
             ) -> tuple[Instants, Array, tuple[float, float], float] | None:
    """Return stamps [ns], yaw [rad], prior of its scale, and lag [s] of gyroscope or wheels."""
    imu = inputs.stream(ImuSample).ordered
    if len(imu) > 2:
        step, rate = np.diff(imu.stamp_ns) / NS_PER_S, imu['rate'][:, 2]
        yaw = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * step))
        return imu.stamp_ns, yaw, (1.0, GYRO_SCALE), 0.0
    wheels = inputs.stream(WheelSample).ordered
    if len(wheels) > 2:
        speed = robot.wheel_radius * wheels['velocity']
        rate = (np.nanmean(speed[:, list(RIGHT)], 1) - np.nanmean(speed[:, list(LEFT)], 1)
                ) / robot.track_width
        yaw = np.append(0.0, np.cumsum(rate[1:] * np.diff(wheels.stamp_ns) / NS_PER_S))
        stamps = wheels.stamp_ns - round(robot.encoder.latency * NS_PER_S)
        # forces that turn the body require slip, so that it lags (calibration/latency.py)
        turning = np.nan_to_num(rate) ** 2
        mean = np.sum(turning * np.nanmean(np.abs(speed), 1)) / max(np.sum(turning), 1e-9)
        lag = mean * robot.yaw_inertia / (robot.tire.longitudinal_stiffness * (
            robot.track_width ** 2 + robot.wheelbase ** 2))
        return stamps, yaw, WHEEL_SCALE, float(lag)
    return None


def _outer(vectors: Array) -> Array:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])


def _six(planar: Array) -> tuple[float, ...]:
    """Return the covariance (36,) of ROS from that of x, y and yaw or their rates."""
    full = PLANAR_VARIANCE * np.eye(6)
    full[np.ix_((0, 1, 5), (0, 1, 5))] = planar
    return tuple(full.ravel().tolist())
