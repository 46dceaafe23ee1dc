# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Kinematic runs with exact ground truth from given wheel speeds and slip velocities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample, WheelSlip
from support.ideal_robot import odometry

START_NS = 1_700_000_000 * NS_PER_S
STEP = 0.001  # s
UNKNOWN_TWIST = (-1.0, *(0.0,) * 35)


@dataclass
class Drive:
    """Samples of a run, and ground truth every millisecond."""

    samples: list
    time: np.ndarray      # s
    pose: np.ndarray      # (n, 3) x, y, yaw
    twist: np.ndarray     # (n, 3) v_x, v_y, yaw rate
    rolling: np.ndarray   # (n, 2) r w of the sides


def drive(rolling, slip_velocities, *, icr=0.02, seed=0, robot=None, imu_rate=100.0,
          wheel_rate=16.0, positions=True, noise=1.0, wheel_latency=0.0, mounting_tilt=0.0):
    """
    Return the run for speeds r w ``rolling`` and slip velocities ``slip_velocities`` (n, 2) [m/s].

    ``noise`` scales the sensor errors; ``mounting_tilt`` [rad] pitches the IMU forward.
    """
    robot = robot or RobotParams()
    rng = np.random.default_rng(seed)
    n = len(rolling)
    time = np.arange(n) * STEP
    side = rolling - slip_velocities
    v_x, W = side.mean(axis=1), (side[:, 1] - side[:, 0]) / robot.track_width
    v_y = -icr * W
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (W[1:] + W[:-1]) * STEP)])
    dx, dy = v_x * np.cos(yaw) - v_y * np.sin(yaw), v_x * np.sin(yaw) + v_y * np.cos(yaw)
    position = [np.concatenate([[0.0], np.cumsum(0.5 * (d[1:] + d[:-1]) * STEP)])
                for d in (dx, dy)]
    r = robot.imu.position
    m_x, m_y = v_x - r[1] * W, v_y + r[0] * W
    a_x, a_y = np.gradient(m_x, STEP) - W * m_y, np.gradient(m_y, STEP) + W * m_x
    gyro_bias = noise * robot.imu.gyro_bias * rng.standard_normal(3)
    accel_bias = noise * robot.imu.accel_bias * rng.standard_normal(3)
    rows = np.arange(round(0.003 / STEP), n, round(1.0 / imu_rate / STEP))
    errors = noise * rng.standard_normal((len(rows), 2, 3))
    still = np.zeros(len(rows))
    force = np.stack([a_x[rows] - mounting_tilt * 9.80665, a_y[rows], still + 9.80665], axis=1)
    rate = np.stack([W[rows] * mounting_tilt, still, W[rows]], axis=1)
    force += accel_bias + robot.imu.accel_noise * errors[:, 0]
    rate += gyro_bias + robot.imu.gyro_noise * errors[:, 1]
    samples = [ImuSample(stamp, tuple(a), tuple(w))
               for stamp, a, w in zip(_stamps(time[rows]), force.tolist(), rate.tolist())]
    samples += _wheels(robot, rng, time, rolling, wheel_rate, positions, noise, wheel_latency)
    samples.sort(key=lambda sample: sample.stamp_ns)
    return Drive(samples, time, np.stack([*position, yaw], axis=1),
                 np.stack([v_x, v_y, W], axis=1), rolling)


def _wheels(robot, rng, time, rolling, rate, positions, noise, latency):
    angle = np.cumsum(rolling, axis=0) * STEP / robot.wheel_radius
    count = 2.0 * np.pi / robot.encoder.counts_per_revolution
    instants = np.arange(0.02, time[-1], 1.0 / rate)
    rows = np.minimum(np.rint(instants / STEP).astype(int), len(time) - 1)
    stamps = instants + latency + noise * robot.encoder.stamp_jitter * rng.standard_normal(
        len(instants))
    position = np.floor(angle[rows][:, [0, 1, 0, 1]] / count
                        + np.array([0.1, 0.6, 0.3, 0.8])) * count
    velocity = np.diff(position, axis=0) / np.diff(stamps)[:, None]
    return [WheelSample(stamp, tuple(speeds), tuple(angles) if positions else None)
            for stamp, speeds, angles in zip(
                _stamps(stamps[1:]), velocity.tolist(), position[1:].tolist())]


def _stamps(time):
    return [START_NS + stamp for stamp in np.rint(time * NS_PER_S).astype(np.int64).tolist()]


def ramp(knots, columns=2):
    """Return values every millisecond, linear between ``knots`` (time, left, right)."""
    knots = np.array(knots, dtype=float)
    time = np.arange(0.0, knots[-1, 0], STEP)
    return np.stack([np.interp(time, knots[:, 0], knots[:, 1 + c]) for c in range(columns)],
                    axis=1)


def driven(count=400, rate=100.0, *, begin_ns=0, speed=0.5, slip=0.1, sigma=0.02, variance=0.01,
           twist=True):
    """Return ``count`` poses and slips; without ``twist`` the velocity is unknown."""
    found = SampleArrays()
    for i in range(count):
        stamp_ns = begin_ns + round(i * 1e9 / rate)
        pose = odometry(stamp_ns, i * speed / rate, v_x=speed, variance=variance)
        found.add_sample(pose if twist else replace(pose, twist_covariance=UNKNOWN_TWIST))
        slips = slip if isinstance(slip, tuple) else (slip,) * 4
        found.add_sample(WheelSlip(stamp_ns, slips, (0.0,) * 4, (sigma,) * 4))
    return found
