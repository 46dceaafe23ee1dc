# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Film sampling by the sensor nodes, and the ground truth of patch crossings."""

import math

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters import build, SimulatorParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.protocol import tire_payload
from smart_tire.samples import FRICTION_QUANTITIES
from smart_tire.simulation.device_emulators import SensorNodeEmulator
from smart_tire.simulation.films import (
    bump, bump_extent, BUMP_HALF_WIDTHS, FilmSampler, NEGLIGIBLE_BUMP, patch_position, SignalChain,
    WheelTrace)
from smart_tire.simulation.truth import CrossingTruth
from smart_tire.uncertain import UNKNOWN

RADIUS, L, FILM, SPACING = 0.087, 0.046, 0.020, 0.030
PERIOD_NS = 2_500_000


class Rolling:
    """Replaces the plant: wheel 1 rolls at a given speed, with constant slip and load."""

    slip_floor = 0.05
    time_ns = 0

    def __init__(self, rolling_speed, slip=0.1, v_y=0.05):
        params = SimulatorParams()
        self._speed = rolling_speed  # m/s, function of time
        self._slip, self._v_y = slip, v_y
        self.wheel_angle = [0.0, 0.5, 0.0, 0.0]
        self.load = [0.0, 26.7, 0.0, 0.0]
        self.surface = [None, Surface(params.ground.friction[0], params.ground.stiffness[0])]
        self._update()

    def _update(self):
        speed = self._speed(self.time_ns * 1e-9)
        self.wheel_speed = [0.0, speed / RADIUS, 0.0, 0.0]
        self.wheel_v_x = [0.0, speed * (1.0 - self._slip), 0.0, 0.0]
        self.wheel_v_y = [0.0, self._v_y, 0.0, 0.0]

    def step(self):
        self.time_ns += 1_000_000
        self._update()
        self.wheel_angle[1] += 1e-3 * self.wheel_speed[1]


class Surface:

    def __init__(self, friction, stiffness):
        self.friction, self.stiffness = friction, stiffness


def new_films(seed=5, **values):
    quiet = {'film.noise': 0.0, 'errors.bending_variation': 0.0, 'errors.bumps': [0.0, 0.0]}
    params = build(SimulatorParams, {**quiet, **values})
    films = FilmSampler('front_right', SensorNodeEmulator(1), params, np.random.default_rng(seed))
    return films, CrossingTruth(films, params.robot), params.robot


def roll(films, truth, plant, seconds):
    batches, crossings = [], []
    for _ in range(round(seconds * 1000)):
        plant.step()
        for batch in films.observe(plant):
            batches.append(batch)
            crossings += truth.ended_in(batch.trace)
    return batches, crossings


def signals(batches):
    """Return times [s] (n,), voltages [V] (n, films) and wheel angles [rad] (n,)."""
    stamps = np.concatenate([batch.trace.stamps_ns for batch in batches]) * 1e-9
    codes = np.concatenate([batch.codes for batch in batches])
    angle = np.concatenate([batch.trace.angle for batch in batches])
    return stamps, codes * 3.3 / 1023, angle


@pytest.fixture(scope='module')
def rolled():
    """Return the films, batches and crossings of a wheel that rolled at 0.5 m/s for 3.2 s."""
    films, truth, _ = new_films()
    return films, *roll(films, truth, Rolling(lambda t: 0.5), 3.2)


def test_every_conversion_occurs_once_at_the_times_of_the_node(rolled):
    _, batches, _ = rolled
    assert all(len(batch.codes) == len(batch.trace.stamps_ns) == 16 for batch in batches)
    assert [batch.first for batch in batches] == list(range(0, 1280, 16))
    stamps, _, angle = signals(batches)
    np.testing.assert_array_equal(np.rint(stamps * 1e9), np.arange(1280) * PERIOD_NS)
    np.testing.assert_allclose(angle, 0.5 + 0.5 / RADIUS * stamps, atol=1e-9)


def test_the_signal_agrees_with_the_film_model_within_half_an_lsb(rolled):
    films, batches, _ = rolled
    _, volts, angle = signals(batches)
    total, critical = math.hypot(0.1, 0.1), 3.0 * 0.47 * 26.7 / 52.7
    for film, (gain, peak) in enumerate(((307.5, 0.83), (242.5, 0.66))):
        past, _ = patch_position(angle, films.center_angles[film], RADIUS)
        expected = 1.65 + tread_film.crossing_voltage(
            past + 0.5 * (L - FILM), slip=0.1, total_slip=total, critical_slip=critical,
            film_length=FILM, contact_length=L, bending_peak=peak, bending_alpha=67.0,
            stretch_gain=gain)
        np.testing.assert_allclose(volts[:, film], expected, atol=0.51 * 3.3 / 1023)


def test_noise_bumps_and_variation_have_the_configured_size():
    films, truth, _ = new_films(**{'film.noise': 0.02, 'errors.bumps': [0.10, 0.15],
                                   'errors.bending_variation': 0.15})
    batches, crossings = roll(films, truth, Rolling(lambda t: 1.0, slip=0.0, v_y=0.0), 20.0)
    _, volts, angle = signals(batches)
    past, revolution = patch_position(angle, films.center_angles[0], RADIUS)
    far = np.abs(past) > 0.15
    assert volts[far, 0].std() == pytest.approx(0.02, rel=0.05)
    flat = np.abs(past) < 0.5 * (L - FILM)
    peaks = np.array([volts[flat & (revolution == index), 0].mean() - 1.65
                      for index in range(1, int(revolution.max()))])
    assert 0.83 * 0.83 < peaks.min() < 0.83 * 0.92 and 0.83 * 1.08 < peaks.max() < 0.83 * 1.17
    before = np.abs(past + 0.5 * (L + FILM) + 0.01) < 0.001
    assert -0.15 < (volts[before, 0].mean() - 1.65) / 0.83 < -0.10
    assert len(crossings) > 30


def outputs(direction=1.0, **values):
    """Return film 1's distance past the patch center, entry first, and its output over 0.83 V."""
    films, truth, _ = new_films(**values)
    plant = Rolling(lambda t: 0.1 * direction, slip=0.0, v_y=0.0)
    plant.wheel_angle[1] = films.center_angles[0] - direction * 0.21 / RADIUS
    batches, _ = roll(films, truth, plant, 4.0)
    _, volts, angle = signals(batches)
    past, _ = patch_position(angle, films.center_angles[0], RADIUS)
    known = np.arange(len(past)) >= 4  # the direction, after some samples
    return direction * past[known], (volts[known, 0] - 1.65) / 0.83


@pytest.mark.parametrize('shape, direction', [
    ('raised_cosine', 1.0), ('gaussian', -1.0), ('asymmetric', 1.0), ('asymmetric', -1.0),
    ('exponential', 1.0)])
def test_bumps_have_the_configured_distance_and_width(shape, direction):
    past, output = outputs(direction, **{
        'errors.bumps': [0.15, 0.15], 'errors.bump_distance': [0.016, 0.013],
        'errors.bump_width': [0.006, 0.010], 'errors.bump_shape': shape,
        'film.release': 'state'})
    outside = np.abs(past) - 0.5 * (L + FILM)
    for side, distance, width in ((past < 0.0, 0.016, 0.006), (past > 0.0, 0.013, 0.010)):
        bump = -output * (side & (outside > 0.0)) / 0.15
        assert bump.max() == pytest.approx(1.0, abs=0.05)
        assert outside[bump == bump.max()].mean() == pytest.approx(distance, abs=0.0007)
        assert np.ptp(outside[bump > 0.5]) == pytest.approx(width, abs=0.0007)


@pytest.mark.parametrize('release, lowest', [('fig8', -0.75), ('state', -0.25)])
def test_a_share_of_the_other_release_moves_the_signal_between_the_conventions(release, lowest):
    past, output = outputs(**{'film.release': release, 'errors.release_share': 0.25})
    assert output.min() == pytest.approx(lowest, abs=0.02)
    assert np.abs(output[np.abs(past) < 0.5 * (L - FILM) - 1e-3] - 1.0).max() < 0.01


def test_a_film_that_stops_inside_and_rolls_back_yields_no_crossing_and_no_jump():
    films, truth, _ = new_films()
    plant = Rolling(lambda t: 0.3 * math.cos(math.pi * t / 1.2) if t > 0.0 else 0.0)
    center = 0.5 * sum(films.center_angles)
    plant.wheel_angle[1] = center - 0.3 * 1.2 / math.pi / RADIUS - 0.01 / RADIUS  # -1 cm
    batches, crossings = roll(films, truth, plant, 1.2)
    _, volts, angle = signals(batches)
    assert volts[:, 0].max() > 2.2  # it was inside
    assert np.abs(np.diff(volts, axis=0)).max() < 0.15
    assert crossings == []


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_the_timestamp_of_a_crossing_is_the_time_at_the_patch_center(direction):
    films, truth, _ = new_films()
    batches, crossings = roll(films, truth, Rolling(lambda t: direction * 0.5), 3.0)
    stamps, volts, angle = signals(batches)
    center = 0.5 * sum(films.center_angles)
    first = [np.flatnonzero(volts[:, film] > 2.0)[0] for film in (0, 1)]
    lead = SPACING / 0.5 / 2.5e-3 * direction  # film 1 enters first forward, last in reverse
    assert first[1] - first[0] == pytest.approx(lead, abs=1.5)
    assert all(p.slip.value == pytest.approx(0.1) for p in crossings) and crossings
    angles = np.interp([p.stamp_ns * 1e-9 for p in crossings], stamps, angle)
    past, _ = patch_position(angles, center, RADIUS)
    np.testing.assert_allclose(past, 0.0, atol=1e-6)
    gaps = np.diff([p.stamp_ns for p in crossings]) * 1e-9
    np.testing.assert_allclose(gaps, math.tau * RADIUS / 0.5, rtol=1e-6)


def test_distant_films_have_separate_crossings():
    three = {'film.positions': [0.0, 0.03, 0.3], 'film.stretch_gain': [300.0] * 3,
             'film.bending_peak': [0.8] * 3}
    films, near, robot = new_films(**three)
    far = CrossingTruth(films, robot, (2,))
    seen, batches = {0: [], 2: []}, []
    plant = Rolling(lambda t: 0.5)
    for _ in range(3000):
        plant.step()
        for batch in films.observe(plant):
            batches.append(batch)
            seen[0] += near.ended_in(batch.trace)
            seen[2] += far.ended_in(batch.trace)
    stamps, volts, angle = signals(batches)
    assert volts.shape[1] == 3
    for first, center in ((0, films.center_angles[0] + 0.015 / RADIUS),
                          (2, films.center_angles[2])):
        assert len(seen[first]) in (2, 3)
        angles = np.interp([p.stamp_ns * 1e-9 for p in seen[first]], stamps, angle)
        np.testing.assert_allclose(patch_position(angles, center, RADIUS)[0], 0.0, atol=1e-6)
    # the stretch voltage is that of film 1, for its group only
    assert math.isfinite(seen[0][0].stretch_voltage.value)
    assert math.isnan(seen[2][0].stretch_voltage.value)


def test_the_true_quantities_are_consistent(rolled):
    *_, crossings = rolled
    value = {name: crossings[0].quantity(name).value for name in FRICTION_QUANTITIES}
    assert value['friction_coefficient'] == value['friction_coefficient_single'] == 0.47
    assert value['total_slip'] == pytest.approx(math.hypot(0.1, 0.1))
    assert value['adhesion_ratio'] == pytest.approx(1 - value['total_slip']
                                                    / value['critical_slip'])
    x_m = L - value['peak_interval'] * 0.5
    assert float(strain_charge.adhesion_length(x_m, FILM, L)) == pytest.approx(
        value['adhesion_length'])
    assert value['traction_force'] == pytest.approx(52.7 * 0.1, rel=0.25)
    assert value['normal_load'] == pytest.approx(26.7)
    assert {crossings[0].quantity(name).sigma for name in FRICTION_QUANTITIES} == {0.0}


def test_two_peak_quantities_are_nan_while_braking():
    films, truth, _ = new_films()
    _, crossings = roll(films, truth, Rolling(lambda t: 0.5, slip=-0.1), 3.0)
    for name in ('stretch_voltage', 'peak_interval'):
        assert crossings[0].quantity(name) == UNKNOWN
    assert crossings[0].traction_force.value < 0.0
    assert crossings[0].slip.value == pytest.approx(-0.1)


def test_the_slip_of_a_crossing_is_the_mean_while_film_1_is_inside():
    films, truth, robot = new_films()
    n = 400
    angle = films.center_angles[0] + np.linspace(-0.12, 0.16, n) / RADIUS
    past, _ = patch_position(angle, films.center_angles[0], RADIUS)
    inside = np.abs(past) <= 0.5 * (L - FILM)
    slip = np.where(inside, 0.2, -0.4)
    one = np.ones(n)
    trace = WheelTrace(tuple(range(n)), angle, 0.5 * one, 0.5 * (1.0 - slip), 0.0 * one,
                       26.7 * one, 0.47 * one, 52.7 * one, 0.05)
    crossing, = truth.ended_in(trace)
    assert crossing.slip.value == pytest.approx(0.2)


def test_crossings_do_not_depend_on_batch_boundaries():
    def run(batch):
        films, truth, _ = new_films(**{'radio.batch': batch})
        return roll(films, truth, Rolling(lambda t: 0.4 + 0.2 * math.sin(3.0 * t)), 6.0)[1]
    assert run(16)[:4] == run(7)[:4] == run(1)[:4] != []


@pytest.mark.parametrize('shape', BUMP_HALF_WIDTHS)
def test_bumps_are_negligible_beyond_their_extent_and_skewed_ones_wider_outside(shape):
    beyond = bump_extent(0.012, 0.009, shape) - 0.012
    assert bump(beyond, 0.009, shape) <= 1.0001 * NEGLIGIBLE_BUMP
    assert bump(0.9 * beyond, 0.009, shape) > NEGLIGIBLE_BUMP
    offset = np.linspace(-0.03, 0.03, 6001)
    wide = offset[bump(offset, 0.01, shape) > 0.5]
    assert -wide.min() > 0.002
    assert (wide.max() > 2.0 * -wide.min()) == (shape in ('asymmetric', 'exponential'))


@given(st.floats(-3.0, 3.0), st.integers(4, 16))
def test_counts_are_clipped_and_quantization_errors_at_most_half_a_count(volts, bits):
    chain = SignalChain(TreadFilmParams(bits=bits))
    counts = chain.counts(np.array([volts, volts + 0.1]))
    assert 0 <= counts[0] <= counts[1] <= chain.max_count == 2**bits - 1
    limited = min(max(volts, -1.65), 1.65)
    assert abs(float(chain.volts(counts)[0]) - limited) <= 0.5 * 3.3 / chain.max_count + 1e-12


def test_counts_agree_with_the_radio_payload():
    chain, counts = SignalChain(TreadFilmParams()), np.arange(1024)
    np.testing.assert_array_equal(chain.counts(chain.volts(counts)), counts)
    np.testing.assert_allclose(
        chain.volts(counts) + 1.65, [tire_payload.volts(code) for code in counts.tolist()])
