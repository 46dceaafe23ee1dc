# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Output of all films of a wheel, compared with the crossing model, and its Jacobian."""

import numpy as np
import pytest

from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction import waveform_model
from smart_tire.estimation.friction.waveform_model import (
    BUMPS, film_index, KNOTS, PerFilm, Release, SHAPE, Shared, WaveformModel)
from smart_tire.models.tire import film_equations, tread_film
from smart_tire.parameters import build, RobotParams
from support.compiled import load_source

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
GAINS, PEAKS = ROBOT.film.stretch_gain, ROBOT.film.bending_peak


def samples(film, center, count=97):
    distance = center + np.linspace(-0.061, 0.0613, count)
    return FilmSamples(film, distance, np.zeros(count), np.zeros(count, np.int8))


FILMS = (samples(0, 0.0), samples(1, 0.03, 61))


def parameters(**shared):
    p = np.zeros(film_index(2, PerFilm.CENTER))
    for name, value in {'SLIP': 0.1, 'NORM_SLIP': 0.2, **shared}.items():
        p[Shared[name]] = value
    for i, one in enumerate(FILMS):
        peak = PEAKS[one.film]
        own = slice(film_index(i, PerFilm.CENTER), film_index(i, PerFilm.GAIN))
        p[own] = 0.03 * i, 0.0, peak, 0.1 * peak, 0.14 * peak
    return p


def expected(one, center, slip, normalized_slip, peak, gain):
    x = one.distance - center + 0.5 * (L - FILM)
    volts = tread_film.crossing_voltage(
        x, slip=slip, total_slip=1.3 * abs(slip), critical_slip=1.3 * abs(slip) / normalized_slip,
        film_length=FILM, contact_length=L, bending_peak=peak,
        bending_alpha=ROBOT.film.bending_alpha, stretch_gain=gain)
    heights = np.where(x < 0.5 * (L - FILM), 0.1, 0.14)
    return volts - heights * peak * tread_film.bumps(x, FILM, L)[0]


@pytest.mark.parametrize('slip', [0.1, -0.2])
def test_the_output_is_that_of_the_crossing_model(slip):
    model = WaveformModel(ROBOT, GAINS, FILMS, 0.0)
    output, _ = model.linearized(parameters(SLIP=slip))
    volts = [expected(one, 0.03 * i, slip, 0.2, PEAKS[i], GAINS[i]) for i, one in enumerate(FILMS)]
    np.testing.assert_allclose(output, np.concatenate(volts), atol=1e-12)


@pytest.mark.skipif(not film_equations.COMPILED, reason='not compiled')
@pytest.mark.parametrize('normalized_slip', [-0.1, 0.2, 1.3])
@pytest.mark.parametrize('alpha', [0.0, -9.0])  # the second one: a series
def test_the_extension_computes_what_its_source_does(normalized_slip, alpha, monkeypatch):
    p = parameters(NORM_SLIP=normalized_slip, CHANGE=0.04, SCALE=0.01, ALPHA=alpha, LENGTH=-0.04)
    p[SHAPE] = 0.2 * np.random.default_rng(2).standard_normal(SHAPE.stop - SHAPE.start)
    model = WaveformModel(ROBOT, GAINS, FILMS, 0.011)
    compiled = model.linearized(p)
    monkeypatch.setattr(waveform_model, 'equations', load_source(film_equations))
    for one, other in zip(compiled, model.linearized(p)):
        np.testing.assert_array_equal(one, other)


def test_arrays_of_other_shapes_are_refused():
    sizes = [(9,)] * 5 + [(2, len(PerFilm)), (film_equations.SHARED,), (2 * KNOTS,),
                          (film_equations.ROWS, 9), (2 * KNOTS, 9)]
    for wrong in range(1, len(sizes)):
        arrays = [np.ones(size, dtype=np.intp if i == 4 else float)
                  for i, size in enumerate(sizes)]
        arrays[4][:] = 0
        arrays[wrong] = np.ascontiguousarray(arrays[wrong][..., :-1])
        with pytest.raises(ValueError, match='shapes'):
            film_equations.linearize(*arrays)


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('normalized_slip', [-0.1, 0.2, 0.8, 1.3])
def test_the_jacobian_agrees_with_finite_differences(release, normalized_slip):
    robot = build(RobotParams, {'film.release': release})
    model = WaveformModel(robot, GAINS, FILMS, 0.011)
    p = parameters(NORM_SLIP=normalized_slip, CHANGE=0.04, SCALE=0.01, ALPHA=0.03,
                   LENGTH=-0.04)
    p[film_index(0, PerFilm.OFFSET)] = 0.01
    p[film_index(1, PerFilm.GAIN)], p[film_index(1, PerFilm.RECOVERY)] = -0.02, 0.2
    p[SHAPE] = 0.2 * np.random.default_rng(1).standard_normal(SHAPE.stop - SHAPE.start)
    _, jacobian = model.linearized(p)
    for k in range(len(p)):
        if normalized_slip < 0.0 and k == Shared.LENGTH:
            continue  # an approximation in the extrapolated range
        step = np.zeros_like(p)
        step[k] = 1e-7
        found = (model.linearized(p + step)[0] - model.linearized(p - step)[0]) / 2e-7
        size = max(np.abs(jacobian[k]).max(), 0.1)
        # derivatives jump where the film begins and ceases to leave
        assert np.mean(np.abs(found - jacobian[k]) > 1e-4 * size) < 0.01, k


@pytest.mark.parametrize('release, other', [('fig8', 'state'), ('state', 'fig8')])
def test_a_share_of_1_is_the_other_release(release, other):
    p = parameters()
    p[SHAPE.start + Release.SHARE] = 1.0
    mixed, pure = (WaveformModel(build(RobotParams, {'film.release': name}), GAINS, FILMS, 0.0)
                   for name in (release, other))
    np.testing.assert_allclose(
        mixed.linearized(p)[0], pure.linearized(parameters())[0], atol=1e-12)


@pytest.mark.parametrize('side', [0, 1])
def test_the_shape_of_a_bump_changes_the_output_on_its_side_only(side):
    p = parameters()
    p[BUMPS].reshape(2, KNOTS)[side, 6:12] = 0.5
    model = WaveformModel(ROBOT, GAINS, FILMS, 0.0)
    change = np.split(model.linearized(p)[0] - model.linearized(parameters())[0],
                      [len(FILMS[0].distance)])
    for i, (one, own) in enumerate(zip(FILMS, change)):
        past = one.distance - 0.03 * i
        assert np.all(own[(past > 0.0) != side] == 0.0)
        # the bump is lower than 0 by its height: 0.1 and 0.14 of the peak
        assert own.min() == pytest.approx(-0.5 * (0.1, 0.14)[side] * PEAKS[one.film], rel=0.1)


def test_growth_is_the_relative_change_of_the_slip_over_a_contact_length():
    model = WaveformModel(ROBOT, GAINS, FILMS, 0.0)
    relative = np.concatenate([one.distance for one in FILMS]) / L
    constant, growing = (model.linearized(parameters(CHANGE=g)) for g in (0.0, 0.5))
    by_slip, by_sliding = constant[1][Shared.SLIP], constant[1][Shared.NORM_SLIP]
    near = np.abs(relative) < 0.02
    expected = 0.5 * relative * (0.1 * by_slip + 0.2 * by_sliding)
    np.testing.assert_allclose((growing[0] - constant[0])[near], expected[near], atol=1e-5)


def test_a_scale_error_expands_each_film_about_its_center():
    expanded = parameters(SCALE=0.02)
    model = WaveformModel(ROBOT, GAINS, FILMS, 0.0)
    scaled = tuple(FilmSamples(one.film, 0.03 * i + 1.02 * (one.distance - 0.03 * i), one.volts,
                               one.rail) for i, one in enumerate(FILMS))
    direct = WaveformModel(ROBOT, GAINS, scaled, 0.0).linearized(parameters())[0]
    np.testing.assert_allclose(model.linearized(expanded)[0], direct, atol=1e-12)


def test_the_output_is_linear_for_negative_normalized_slip():
    model = WaveformModel(ROBOT, GAINS, FILMS, 0.0)
    outputs = [model.linearized(parameters(NORM_SLIP=w))[0] for w in (-0.2, -0.1, 0.0)]
    np.testing.assert_allclose(outputs[0] - outputs[1], outputs[1] - outputs[2], atol=1e-12)
