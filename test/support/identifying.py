# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Kinematic recordings as the calibrations read them, with exact truth."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.signal import oaconvolve
from smart_tire.bags import BagWriter
from smart_tire.calibration.recording import (
    CalibrationRecording, ImuRecord, PoseRecord, WheelRecord)
from smart_tire.parameters import build, RobotParams, SimulatorParams
from smart_tire.rotation import quaternion
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, WheelSample
from smart_tire.simulation.offline import simulate
from support.driving import Drive, drive, START_NS, STEP

TRACK = 0.57  # m, effective; the geometric one is 0.38 m
PAUSE = 3.0   # s of standstill at both ends


def random_signal(rng, seconds, size, time):
    """Return a smooth random signal of standard deviation ``size``, every millisecond."""
    reach = round(4.0 * time / STEP)
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) * STEP / time) ** 2)
    noise = np.pad(rng.standard_normal(round(seconds / STEP)), reach, 'symmetric')
    # the kernel has thousands of taps: summing them one by one took most of the tests' time
    smooth = oaconvolve(noise, bell, 'valid')
    return size * smooth / smooth.std()


@lru_cache(maxsize=32)
def turning_run(seed, seconds=60.0, *, track=TRACK, slip=0.01, turn=0.25, robot=None, **options):
    """
    Return a run of ``drive`` with random speeds of both sides, stationary at both ends.

    ``slip`` [m/s] is the standard deviation of the slip velocities of the sides, ``turn`` [m/s]
    that of their speed difference.
    """
    robot = robot or RobotParams()
    rng = np.random.default_rng([seed, 7])
    n = round(seconds / STEP)
    mean = 0.6 + random_signal(rng, seconds, 0.15, 1.0)
    difference = random_signal(rng, seconds, turn, 0.5)
    time = np.arange(n) * STEP
    window = np.clip(np.minimum(time - PAUSE, seconds - PAUSE - time), 0.0, 1.0)[:, None]
    rolling = window * np.stack([mean - 0.5 * difference, mean + 0.5 * difference], axis=1)
    lost = 0.5 * (rolling[:, 1] - rolling[:, 0]) * (1.0 - robot.track_width / track)
    sliding = np.stack([-lost, lost], axis=1) + window * np.stack(
        [random_signal(rng, seconds, slip, 0.7) for _ in range(2)], axis=1)
    return drive(rolling, sliding, seed=seed, robot=robot, **options)


def recorded(run, reference_noise=None, seed=0):
    """Return the recording of a run, with a reference of this noise [m, rad] unless None."""
    imu = [s for s in run.samples if isinstance(s, ImuSample)]
    wheels = [s for s in run.samples if isinstance(s, WheelSample)]
    rng = np.random.default_rng([seed, 8])
    poses = None
    if reference_noise is not None:
        some = slice(None, None, 50)  # 20 Hz
        measured = run.pose[some] + reference_noise * rng.standard_normal(run.pose[some].shape)
        poses = PoseRecord(run.time[some], measured[:, :2], measured[:, 2])
    return CalibrationRecording(
        ImuRecord(seconds_of(imu), np.array([s.rate for s in imu]),
                  np.array([s.acceleration for s in imu])),
        WheelRecord(seconds_of(wheels), np.array([s.velocity for s in wheels]),
                    None if wheels[0].position is None else
                    np.array([s.position for s in wheels])), poses)


def simulated(legs, seconds, seed, **values):
    """Return the recording of the simulated robot on one ground, by default on concrete."""
    params = build(SimulatorParams, {'seed': seed, 'ground.base': 'concrete', 'film.wheels': [],
                                     'ground.patches.names': [], **values})
    samples = [sample for _, topic, sample in simulate(params, legs, seconds, start_ns=START_NS)
               if topic in ('imu/data', 'wheel_states')]
    return recorded(Drive(samples, *(np.empty(0),) * 4))


def seconds_of(samples):
    """Return the timestamps of samples in seconds after the start of a run."""
    return np.array([(s.stamp_ns - START_NS) / NS_PER_S for s in samples])


def errors_of(estimates, true):
    """Return the errors of estimates over their standard errors; ``true`` may be one value."""
    values, sigmas = np.array([(one.value, one.sigma) for one in estimates]).T
    return (values - true) / sigmas


def rms(values):
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def assert_agrees(estimate, true, sigmas=3.0):
    """Check that an estimate is within ``sigmas`` standard errors of the truth."""
    assert abs(estimate.value - true) <= sigmas * estimate.sigma, f'{estimate}, not {true}'


def assert_consistent(estimates, true, low, high):
    """Check the rms of errors over standard errors, of three or less that none exceeds three."""
    errors = errors_of(estimates, true)
    assert np.max(np.abs(errors)) < 3.0 if len(errors) <= 3 else low < rms(errors) < high, errors


def write_run(path, run, reference=None):
    """Write a run to a bag at ``path``; its poses at 20 Hz to the topic ``reference``."""
    unknown = (-1.0,) + (0.0,) * 35
    events = [('imu/data' if isinstance(s, ImuSample) else 'wheel_states', s)
              for s in run.samples]
    if reference is not None:
        events += [(reference, Odometry(
            START_NS + round(time * NS_PER_S), (x, y, 0.0), quaternion(0.0, 0.0, yaw), (0.0,) * 3,
            (0.0,) * 3, (1e-4,) * 36, unknown))
            for time, (x, y, yaw) in zip(run.time[::50], run.pose[::50])]
    with BagWriter(path) as writer:
        for topic, sample in sorted(events, key=lambda event: event[1].stamp_ns):
            writer.write_sample(topic, sample.stamp_ns, sample)
    return path
