"""
Dead reckoning by wheels, and by gyroscope and wheels: for this comparison only.

Each gets what it can be given: angles and not speeds, speeds by central differences (which look
ahead), the bias of the gyroscope from the standstill at the start. Constants that are fitted are
fitted to the truth of the very run.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.slip.inputs import Inputs
from benchmarks.slip.series import EstimateSeries
from smart_tire.analysis.metrics import aligned
from smart_tire.analysis.series import at, Floats, PoseSeries, SlipSeries, Stamps
from smart_tire.models.vehicle.skid_steer import slip_ratio
from smart_tire.samples import NS_PER_S

LEAST_TURN = 0.1  # m that one side rolls further than the other: less fits no track
GAP = 5.0         # s of silence that are bridged by a straight line


def wheel_odometry(inputs: Inputs, track: float) -> EstimateSeries:
    """Return the way of a differential drive of ``track`` [m] with these wheels."""
    travel, rolling = inputs.travel, inputs.rolling
    yaw = _heading(inputs, track)
    rate = (rolling[:, 1] - rolling[:, 0]) / track
    return _reckoned(inputs, inputs.wheel_ns, yaw, travel.mean(axis=1), rate, rolling)


def fitted_track(inputs: Inputs, truth: PoseSeries) -> float:
    """Return the track [m] with which the heading is best, by least squares over the run."""
    estimate = wheel_odometry(inputs, 1.0)  # then the yaw is the difference of the sides
    guess, true, _ = aligned(truth, estimate.poses)
    if not len(guess):
        return inputs.robot.track_width
    apart, turned = guess[:, 2] - guess[0, 2], true[:, 2] - true[0, 2]
    if np.ptp(apart) < LEAST_TURN:
        return inputs.robot.track_width
    return float(apart @ apart / (apart @ turned))


def gyro_odometry(inputs: Inputs, scale: float = 1.0) -> EstimateSeries:
    """Return the way by the gyroscope's heading and the wheels' mean, ``scale`` times as long."""
    stamps = inputs.imu_ns
    bias = inputs.rate[:inputs.resting].mean() if inputs.resting else 0.0
    rate = inputs.rate - bias
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(stamps) / NS_PER_S
    yaw = np.concatenate([[0.0], np.cumsum(steps)])
    travel = at(stamps, inputs.wheel_ns, inputs.travel, GAP)
    rolling = at(stamps, inputs.wheel_ns, inputs.rolling, GAP)
    known = np.isfinite(travel[:, 0])
    return _reckoned(inputs, stamps[known], yaw[known], scale * travel[known].mean(axis=1),
                     rate[known], rolling[known], scale)


def fitted_scale(inputs: Inputs, truth: PoseSeries) -> float:
    """Return the factor on the wheels' radius with which the position is best, likewise."""
    guess, true, _ = aligned(truth, gyro_odometry(inputs).poses)
    if not len(guess):
        return 1.0
    reckoned, gone = guess[:, :2] - guess[0, :2], true[:, :2] - true[0, :2]
    square = float(np.sum(reckoned ** 2))
    return float(np.sum(reckoned * gone)) / square if square > LEAST_TURN ** 2 else 1.0


def _heading(inputs: Inputs, track: float) -> Floats:
    apart = inputs.travel[:, 1] - inputs.travel[:, 0]
    heading: Floats = (apart - apart[0]) / track
    return heading


def _reckoned(inputs: Inputs, stamps: Stamps, yaw: Floats, way: Floats, rate: Floats,
              rolling: Floats, scale: float = 1.0) -> EstimateSeries:
    """Return the estimate of a robot that goes ``way`` [m] along ``yaw`` [rad] in arcs."""
    turn = np.diff(yaw)
    chord = np.diff(way) * np.sinc(0.5 * turn / math.pi)
    middle = yaw[:-1] + 0.5 * turn
    x, y = (np.concatenate([[0.0], np.cumsum(chord * f(middle))]) for f in (np.cos, np.sin))
    v_x = scale * rolling.mean(axis=1)
    twist = np.column_stack([v_x, np.zeros(len(v_x)), rate])
    unknown = np.full((len(yaw), 3, 3), math.nan)
    poses = PoseSeries(stamps, np.column_stack([x, y, yaw]), twist, unknown, unknown[:, 0])
    half = 0.5 * inputs.robot.track_width
    return EstimateSeries(poses, side_slips(stamps, rolling, np.column_stack(
        [v_x - half * rate, v_x + half * rate]), inputs.robot.slip.standstill_speed))


def side_slips(stamps: Stamps, rolling: Floats, ground: Floats, standstill: float,
               ground_sigma: Floats | None = None) -> SlipSeries:
    """Return slips from r w and v_x (n, 2) of the sides, with sigmas if ground speeds have any."""
    ratio = slip_ratio(rolling, ground, standstill)
    sigma = np.full_like(ratio, math.nan)
    if ground_sigma is not None:
        sigma = np.minimum(ground_sigma / np.maximum(np.abs(rolling), 1e-9), 1.0)
    sigma = np.where(np.isnan(ratio), 1.0, sigma)
    sides = [0, 1, 0, 1]
    return SlipSeries(stamps, ratio[:, sides], sigma[:, sides])
