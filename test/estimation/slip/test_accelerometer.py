# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is learned of the accelerometer on unknown ground."""

import math

import numpy as np
import pytest
from smart_tire.estimation.slip.accelerometer import AccelerometerModel
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.state import SLIP_CHANGE_SHARE, SPEED_WALK
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import GRAVITY, ImuSample, NS_PER_S, Odometry, WheelSample

STEP, PERIOD = 0.01, 0.1  # s, of the IMU and of the wheels


def learned(acceleration, measured, *, walk=SPEED_WALK):
    """Return a model after true and measured accelerations (n,) [m/s2] at steps of ``STEP``."""
    model, speed, mean = AccelerometerModel(walk), 0.0, 0.0
    every = round(PERIOD / STEP)
    for i, (true, one) in enumerate(zip(acceleration, measured), 1):
        model.add_acceleration(one, STEP)
        speed += true * STEP
        mean += (speed - 0.5 * true * STEP) / every
        if i % every == 0:
            model.add_speed(mean, PERIOD, learn=True)
            mean = 0.0
    return model


def white(density, seed, duration=100.0):
    """Return white noise (n,) [m/s2] of a density [(m/s2)^2 s]."""
    n = round(duration / STEP)
    return np.random.default_rng(seed).normal(0.0, math.sqrt(density / STEP), n)


def test_a_perfect_accelerometer_is_trusted():
    motion = white(SPEED_WALK ** 2, 1)
    model = learned(motion, motion)
    assert model.share > 0.97 and model.density < 1e-3


def test_noise_is_learned_with_its_density_and_shrinks_the_share():
    """Regression with noise of the regressor: w / (w + q) of it is motion, w q / (w + q) left."""
    w, q = 0.1, 0.1
    found = [learned(white(w, seed), white(w, seed) + white(q, 50 + seed), walk=math.sqrt(w))
             for seed in range(8)]
    # half of both moments is that of the prior
    share = (w + w) / (w + q + w)
    assert np.mean([one.share for one in found]) == pytest.approx(share, rel=0.1)
    left = w - SLIP_CHANGE_SHARE ** 2 * w - share * (2.0 * w - share * (w + q))
    assert np.mean([one.density for one in found]) == pytest.approx(left, rel=0.25)


def test_a_slope_is_no_motion_and_a_steady_drive_forgets_nothing():
    n = round(60.0 / STEP)
    rolling = 0.5 * np.sin(math.tau / 3.0 * STEP * np.arange(n))
    own, prior = 0.5 * 0.5 ** 2 / ((math.tau / 3.0) ** 2 + 1.0), 0.5 * SPEED_WALK ** 2
    assert learned(np.zeros(n), rolling).share == pytest.approx(prior / (own + prior), rel=0.05)
    assert learned(np.zeros(n), white(1e-4, 3, 60.0)).share > 0.95


def test_the_share_has_the_sign_of_motion():
    motion = white(0.4, 4)
    assert learned(motion, -motion).share == 0.0


def test_samples_without_permission_are_not_learned():
    model = AccelerometerModel(SPEED_WALK)
    for _ in range(100):
        model.add_acceleration(3.0, PERIOD)
        model.add_speed(0.0, PERIOD, learn=False)
    assert (model.share, model.density) == (1.0, 0.0)


def lateral_speeds(amplitude, period=3.0, duration=40.0):
    """Return estimated v_y (n,) [m/s] of a straight drive while the body rolls."""
    estimator, found = SlipEstimator(build(SlipEstimatorParams, {
        'imu.position': [0.0, 0.0, 0.0]})), []
    for i in range(round(duration / STEP)):
        time = i * STEP
        stamp_ns = round((1.0 + time) * NS_PER_S)
        roll = amplitude * math.sin(math.tau * time / period) if time > 2.0 else 0.0
        samples = [ImuSample(stamp_ns, (0.0, roll, GRAVITY), (0.0, 0.0, 0.0))]
        if i % 10 == 0:
            speed = min(max(time - 2.0, 0.0), 0.5) / 0.087
            samples.append(WheelSample(stamp_ns, (speed,) * 4, None, None))
        found += [one for sample in samples for one in estimator.update(sample)
                  if isinstance(one, Odometry)]
    return np.array([one.linear[1] for one in found if one.stamp_ns > 20 * NS_PER_S])


def test_roll_on_the_suspension_is_not_taken_for_lateral_motion():
    """Its integral would be 0.24 m/s; with an accelerometer that is trusted it is 58 mm/s."""
    assert np.abs(lateral_speeds(0.5)).max() < 0.035
