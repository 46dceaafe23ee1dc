# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Trajectory of a wheel: interpolated, and smoothed without overshoot at a stop."""

import math

import numpy as np
from numpy.polynomial.legendre import legfit
import pytest
from scipy.interpolate import PchipInterpolator

from smart_tire.estimation.contact.smoothing import shape_error_sigmas, SmoothedTrajectory
from smart_tire.estimation.contact.trajectory import WheelTrajectory
from smart_tire.samples import NS_PER_S
from support.rolling import along, ROBOT, stamp, steady

R = ROBOT.wheel_radius
JITTER = ROBOT.encoder.stamp_jitter


def recorded(trajectory, duration, *, rate=16.0, jitter=0.0, positions=True, seed=0):
    rng = np.random.default_rng(seed)
    wheel = WheelTrajectory(R, 2000.0, JITTER)
    count, before = 2000.0 / (2.0 * np.pi), 0.0
    for i, time in enumerate(np.arange(0.0, duration, 1.0 / rate)):
        angle = np.floor(float(trajectory(np.array(time + 1e-9))) / R * count) / count
        wheel.add_wheel(stamp(time + jitter * rng.standard_normal()),
                        (angle - before) * rate if i else 0.0, angle if positions else None)
        before = angle
    return wheel


def test_timestamp_jitter_is_smoothed_out_of_the_speed():
    errors = []
    for seed in range(24):
        rpm = (60.0, 120.0, 200.0)[seed % 3]
        speed, wheel = rpm / 60.0 * 2.0 * np.pi * R, recorded(
            steady(rpm), 4.0, jitter=JITTER, seed=seed)
        smooth = wheel.smooth(stamp(2.0), stamp(2.1))
        rolled = np.diff(smooth.distance_at(np.array([stamp(2.0), stamp(2.1)])))[0]
        errors.append((rolled / 0.1 - speed) / smooth.speed_sigma)
        assert smooth.speed_sigma < 0.01 * speed
    assert np.std(errors) < 1.5


def test_a_stop_is_smoothed_without_overshoot_for_any_duration():
    wheel = recorded(
        along([(0.0, 0.0), (1.0, 0.0), (2.0, 0.4), (40.0, 0.4), (41.0, 0.8)]), 42.0)
    times = np.array([stamp(t) for t in (5.0, 10.0, 20.0, 35.0)])
    smooth = wheel.smooth(stamp(1.5), stamp(40.5)).distance_at(times)
    assert np.ptp(smooth) < 0.002
    assert smooth[0] == pytest.approx(wheel.interpolate(times)[0], abs=0.005)


@pytest.mark.parametrize('count', [2, 3, 40])
def test_between_samples_the_trajectory_is_a_monotone_cubic_spline(count):
    rng = np.random.default_rng(count)
    times = np.cumsum(rng.uniform(0.01, 0.1, count)).round(9)
    angles = np.cumsum(rng.choice([-1.0, 0.0, 1.0, 2.0], count))
    smooth = SmoothedTrajectory(stamp(0.0), times, angles, R, 1e-6)
    assert smooth.distance_at(stamp(0.0) + (times * NS_PER_S).round().astype(int)) == \
        pytest.approx(R * angles, abs=1e-12)
    if count > 3:  # scipy has the same slopes except at the ends
        instants = stamp(0.0) + (rng.uniform(*times[[1, -2]], 99) * NS_PER_S).astype(int)
        expected = PchipInterpolator(times, R * angles)((instants - stamp(0.0)) / NS_PER_S)
        assert smooth.distance_at(instants) == pytest.approx(expected, abs=1e-12)


def test_speeds_alone_give_the_same_trajectory_as_angles():
    trajectory = along([(0.0, 0.0), (1.0, 0.0), (3.0, 1.5), (4.0, 1.0)])
    times = np.array([stamp(t) for t in np.arange(0.2, 3.9, 0.1)])
    with_angles, without = (recorded(trajectory, 4.0, positions=p).interpolate(times)
                            for p in (True, False))
    np.testing.assert_allclose(with_angles, without, atol=1e-6)


@pytest.mark.parametrize('gap_ns', [1, 20, 5_000, 999_999])
def test_angles_that_nearly_coincide_do_not_disturb_the_smoothing(gap_ns):
    def smoothed(repeated):
        trajectory = WheelTrajectory(ROBOT.wheel_radius, 2000.0, 1e-3)
        for k in range(40):
            trajectory.add_wheel(stamp(k / 16.0), 6.0, 6.0 * k / 16.0)
            if repeated:
                trajectory.add_wheel(stamp(k / 16.0) + gap_ns, 6.0, 6.0 * k / 16.0)
        return trajectory.smooth(stamp(1.0), stamp(1.5)).distance_at(
            np.array([stamp(1.1), stamp(1.4)]))
    assert smoothed(True).tolist() == smoothed(False).tolist()


def test_an_encoder_reset_is_not_rolled_distance():
    wheel = WheelTrajectory(R, 2000.0, JITTER)
    for i in range(20):
        wheel.add_wheel(stamp(0.0625 * i), 10.0, 0.625 * i - (500.0 if i > 10 else 0.0))
    assert wheel.interpolate(np.array([stamp(0.0625 * 19)]))[0] == pytest.approx(R * 0.625 * 19)


def test_the_timestamp_latency_is_subtracted():
    late = WheelTrajectory(R, 2000.0, JITTER, latency=0.02)
    late.add_wheel(stamp(1.0), 0.0, 0.0)
    assert late.newest_ns == stamp(0.98)


def test_a_silent_wheel_is_extrapolated_for_a_limited_time():
    wheel = recorded(steady(60.0), 2.0)
    newest = wheel.newest_ns
    ahead = wheel.interpolate(np.array([newest, newest + 300_000_000, newest + 10**10]))
    assert ahead[1] - ahead[0] == pytest.approx(0.3 * 2.0 * np.pi * R, rel=0.05)
    assert ahead[2] - ahead[0] < 1.1 * 2.0 * np.pi * R


def test_a_segment_maps_distance_to_time_and_reports_changes_of_speed():
    wheel = recorded(along([(0.0, 0.0), (4.0, 2.0), (6.0, 2.0), (10.0, 4.0)]), 10.0)
    segment = wheel.segment(0.9, 1.1, stamp(10.0))
    assert segment.instant_at(0.1) == pytest.approx(stamp(2.0), abs=3_000_000)
    assert segment.distance_at(segment.instant_at(0.05)) == pytest.approx(0.05, abs=1e-3)
    assert segment.speed_change(0.02) < 0.1
    assert wheel.segment(1.95, 2.05, stamp(10.0)).speed_change(0.02) > 1.0


def simulated(rng, density, cutoff, duration, count):
    """Return Legendre coefficients (n, 8) of noise with the described density."""
    total, step = 40.0 * duration, duration / 100.0
    n = round(total / step)
    frequency = np.fft.rfftfreq(n, step) * 2.0 * math.pi
    amplitude = np.sqrt(density / (1.0 + (frequency / cutoff)**6) / step)
    found = []
    for _ in range(count):
        noise = np.fft.irfft(amplitude * np.fft.rfft(rng.standard_normal(n)), n)
        for start in range(0, n - 101, 200):
            found.append(legfit(np.linspace(-1.0, 1.0, 101), noise[start:start + 101], 7))
    return np.array(found)


@pytest.mark.parametrize(('cutoff', 'duration'), [(10.0, 0.2), (10.0, 0.8), (20.0, 1.0)])
def test_the_sigmas_are_those_of_simulated_noise(cutoff, duration):
    density = 1e-7
    found = np.std(simulated(np.random.default_rng(0), density, cutoff, duration, 30), axis=0)
    sigmas = shape_error_sigmas(density, cutoff, duration)
    np.testing.assert_allclose(sigmas[:4], found[2:6], rtol=0.25)


def test_negligible_polynomials_are_left_out():
    wheel = recorded(steady(120.0), 6.0, jitter=JITTER)
    short, long = (wheel.smooth(stamp(2.0), stamp(end)).errors(stamp(2.0), stamp(end))
                   for end in (2.15, 5.0))
    assert len(short.shape_sigmas) < len(long.shape_sigmas)
    assert short.scale_sigma > long.scale_sigma > 0.0
    for errors in (short, long):
        assert all(sigma > 1e-4 * R for sigma in errors.shape_sigmas)
