# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The fit of one patch crossing, on crossings cut out of simulated drives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire import fit_crossing, load_params, simulate
from smart_tire.errors import EstimatorError, ParameterError

WHEELS = 'front_left', 'front_right'
VALUES = {'film.wheels': list(WHEELS), 'ground.base': 'concrete'}
REACH = 0.085          # m, of travel before and after the crossing
SPEED_NS = 150_000_000  # ns before and after it, over which the wheel speed is the mean


class Crossing:
    """Samples of one simulated crossing, with the true values."""

    def __init__(self, recording, index):
        truth, self.wheel = recording.truth.friction, str(recording.truth.friction.wheel[index])
        stamp, films, wheels = truth.stamp_ns[index], recording.films[self.wheel], recording.wheels
        self.slip, self.total, self.adhesion, self.mu = (
            float(one.value[index]) for one in (truth.slip, truth.total_slip, truth.adhesion_ratio,
                                                truth.friction_coefficient))
        near = np.abs(wheels.stamp_ns - stamp) < SPEED_NS
        self.speed = float(wheels.velocity[near, WHEELS.index(self.wheel)].mean())
        shown = np.abs(films.stamp_ns - stamp) * 1e-9 < REACH / (0.087 * abs(self.speed))
        self.time, self.volts = (films.stamp_ns[shown] - stamp) * 1e-9, films.volts[shown]

    def fit(self, films=slice(None), **changed):
        """Return the fit; ``changed`` are arguments in place of those of the crossing."""
        given = {'time': self.time, 'volts': self.volts[:, films], 'wheel_speed': self.speed,
                 'wheel': self.wheel, 'params': load_params(values=VALUES),
                 'lateral_slip': math.sqrt(self.total**2 - self.slip**2), **changed}
        return fit_crossing(given.pop('time'), given.pop('volts'), given.pop('wheel_speed'),
                            **given)


def crossings(speeds, seed, **values):
    """Return the crossings of eight seconds at constant wheel speeds, after the start."""
    recording = simulate([(0.5, *speeds)], 8.0, seed=seed, wheel_rate=50.0,
                         params=load_params(values=VALUES | values))
    begin = recording.wheels.stamp_ns[0] + 2_000_000_000
    end = recording.wheels.stamp_ns[-1] - 1_000_000_000
    return [Crossing(recording, index)
            for index, stamp in enumerate(recording.truth.friction.stamp_ns)
            if begin < stamp < end]


@pytest.fixture(scope='module')
def turn():
    """Return the crossings of a turn."""
    return crossings((12.0, 6.0), 11)


@pytest.mark.parametrize('films, first', [(slice(None), 0), (0, 0), (1, 1)],
                         ids=['both', 'film 1', 'film 2'])
def test_values_are_right_within_their_standard_deviations(turn, films, first):
    assert len(turn) > 12
    fits = [one.fit(films, film=first) for one in turn]
    for name, truth in (('slip', [one.slip for one in turn]),
                        ('adhesion_ratio', [one.adhesion for one in turn]),
                        ('contact_length', [0.046] * len(turn)),
                        ('adhesion_length', [0.046 * one.adhesion for one in turn]),
                        ('tread_deflection', [0.046 * one.adhesion * one.total for one in turn]),
                        ('friction_coefficient', [one.mu for one in turn])):
        found = np.array([getattr(fit, name) for fit in fits])
        errors = (found[:, 0] - truth) / found[:, 1]
        assert 0.05 < np.mean(errors**2) < 3.0, name
        assert np.abs(errors).max() < 4.5, name
    assert np.median([abs(fit.friction_coefficient.value / one.mu - 1.0)
                      for fit, one in zip(fits, turn)]) < 0.1
    assert all(abs(fit.time) < 0.06 and fit.residual < 0.03 for fit in fits)


def test_derived_values_follow_from_slip_and_adhesion(turn):
    fit, total = turn[0].fit(), turn[0].total
    assert fit.adhesion_ratio.value == pytest.approx(1.0 - fit.normalized_slip.value)
    assert fit.contact_angle.value == pytest.approx(fit.contact_length.value / 0.087)
    assert fit.adhesion_length.value == pytest.approx(
        fit.adhesion_ratio.value * fit.contact_length.value)
    assert fit.tread_deflection.value == pytest.approx(total * fit.adhesion_length.value, rel=0.2)
    assert 0.0 < fit.tread_deflection.sigma < 0.2 * fit.tread_deflection.value


def test_the_contact_length_is_found_unless_it_is_known():
    one = crossings((12.0, 6.0), 12, **{'tire.contact_length': 0.050})[3]
    found = one.fit()
    assert abs(found.contact_length.value - 0.050) < 3.0 * found.contact_length.sigma < 0.003
    assert one.fit(length_sigma=0.0).contact_length == (0.046, 0.0)


def test_rolling_backward_the_films_enter_in_the_other_order():
    for one in crossings((-12.0, -6.0), 13)[:4]:
        fit = one.fit()
        assert abs(fit.slip.value - one.slip) < 4.0 * fit.slip.sigma < 0.05


def test_other_times_and_varying_speeds_give_the_same_values(turn):
    one = turn[2]
    fit = one.fit()
    later = one.fit(time=one.time + 1e6, wheel_speed=np.full(len(one.time), one.speed))
    assert later.time - 1e6 == pytest.approx(fit.time, abs=1e-6)
    assert later.slip == pytest.approx(fit.slip, rel=1e-3)


def test_friction_is_unknown_at_low_slip_and_scales_with_the_load(turn):
    straight = crossings((12.0, 12.0), 14)[2]
    assert math.isnan(straight.fit().friction_coefficient.value)
    one = turn[2]
    light, heavy = (one.fit(load=load).friction_coefficient.value for load in (20.0, 30.0))
    assert light / heavy == pytest.approx(1.5, rel=0.1)


def test_an_uncertain_wheel_speed_is_corrected_by_the_length_of_the_films(turn):
    one = turn[4]
    fit = one.fit(wheel_speed=1.05 * one.speed, speed_sigma=0.05)
    assert abs(fit.contact_length.value - 0.046) < 2.5 * fit.contact_length.sigma < 0.0025


@pytest.mark.parametrize('changed, text', [
    ({'time': lambda one: one.time[::-1]}, 'time does not increase in row 1'),
    ({'time': lambda one: np.where(one.time > 0.0, np.nan, one.time)}, 'time has NaN'),
    ({'volts': lambda one: np.where(one.time > 0.0, np.nan, one.volts[:, 0])}, 'volts has NaN'),
    ({'wheel_speed': lambda one: math.inf}, 'wheel_speed has NaN or infinite'),
    ({'time': lambda one: one.time[1:]}, 'have shapes'),
    ({'wheel_speed': lambda one: [1.0, 2.0]}, 'have shapes'),
    ({'film': lambda one: 1}, 'films 2 to 3 of front_.*: front_.* has 2 films'),
    ({'wheel': lambda one: 'rear_left'}, 'rear_left has 0 films'),
    ({'wheel': lambda one: 'left'}, 'left')])
def test_invalid_arguments_are_refused(turn, changed, text):
    with pytest.raises(ParameterError, match=text):
        turn[0].fit(**{name: value(turn[0]) for name, value in changed.items()})


@pytest.mark.parametrize('changed, text', [
    ({'volts': lambda one: np.full(len(one.time), 1.65)}, '0 patch crossings in 0.'),
    ({'wheel_speed': lambda one: 0.0}, '0 patch crossings'),
    ({'wheel_speed': lambda one: 4.0 * one.speed}, 'expected one|not that of a film')])
def test_samples_without_a_crossing_are_refused(turn, changed, text):
    with pytest.raises(EstimatorError, match=text):
        turn[0].fit(**{name: value(turn[0]) for name, value in changed.items()})


def test_two_crossings_are_refused(turn):
    one = turn[0]
    time = np.concatenate([one.time, one.time + math.tau / one.speed])
    with pytest.raises(EstimatorError, match='2 patch crossings'):
        one.fit(time=time, volts=np.concatenate([one.volts, one.volts]))
