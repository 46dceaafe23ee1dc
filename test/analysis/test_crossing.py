# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The waveform of a crossing: places of the films, the model, and what is missing."""

import math

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from smart_tire.analysis.crossing import crossing_waveform
from smart_tire.models.tire.tread_film import crossing_voltage
from smart_tire.parameters import build, RobotParams
from smart_tire.samples import Friction, NS_PER_S
from smart_tire.uncertain import Uncertain

EPOCH = 1_700_000_000 * NS_PER_S
ROBOT = RobotParams()
OMEGA = 2.0 * math.pi  # rad/s, 60 rpm
SPEED = ROBOT.wheel_radius * OMEGA
CROSSING = Friction(EPOCH, 'front_left', film_slip=Uncertain(0.1, 0.01),
                    adhesion_ratio=Uncertain(0.8, 0.05))


def stamps(count=400):
    return EPOCH + np.round((np.arange(count) - count // 2) / 400.0 * NS_PER_S).astype(np.int64)


def voltages(place, peak=0.5, speed=SPEED):
    """Return the voltages of a film that is ``place`` [m] behind the center of the wheel's."""
    film, patch = ROBOT.film, ROBOT.tire.contact_length
    position = speed * (stamps() - EPOCH) / NS_PER_S - place
    return 1.6 + crossing_voltage(
        position + 0.5 * (patch - film.length), slip=0.1, total_slip=0.2, critical_slip=1.0,
        film_length=film.length, contact_length=patch, bending_peak=peak,
        bending_alpha=film.bending_alpha, stretch_gain=film.gains('front_left')[0])


@settings(max_examples=20, deadline=None)
@given(forward=st.booleans(), shift=st.floats(-0.003, 0.003), peak=st.floats(0.3, 1.0))
def test_the_model_fits_films_that_are_not_quite_where_they_are_configured(forward, shift, peak):
    first, second = (voltages(place + shift, peak) for place in (-0.015, 0.015))
    volts = np.column_stack([first, second] if forward else [second, first])
    found = crossing_waveform(CROSSING, stamps(), volts, OMEGA if forward else -OMEGA, ROBOT)
    assert found.speed == pytest.approx(SPEED)
    for film in found.films:
        assert film.rest == pytest.approx(1.6, abs=0.02)
        model = np.interp(film.position, film.model_position, film.model_volts)
        assert model == pytest.approx(film.volts, abs=0.12)
        assert found.time_ms(film, film.position[0]) == pytest.approx(
            -1e3 * 1.5 * ROBOT.tire.contact_length / SPEED, abs=2.6)  # a sample at 400 Hz
    order = [film.delay for film in found.films]
    assert order == (sorted(order) if forward else sorted(order, reverse=True))
    assert sum(order) == pytest.approx(0.0)
    assert abs(order[1] - order[0]) == pytest.approx(0.030 / SPEED)


def test_the_time_in_the_patch_is_that_of_patch_and_film():
    found = crossing_waveform(CROSSING, stamps(), np.ones((400, 2)), OMEGA, ROBOT)
    assert 2.0 * found.reach == pytest.approx(0.066)


def test_without_slip_or_adhesion_there_is_no_model():
    found = crossing_waveform(Friction(EPOCH, 'front_left'), stamps(), np.ones((400, 2)), OMEGA,
                              ROBOT)
    assert [len(film.model_volts) for film in found.films] == [0, 0]


@pytest.mark.parametrize('omega', [0.0, math.nan])
def test_a_wheel_that_stands_or_has_no_speed_has_no_waveform(omega):
    assert crossing_waveform(CROSSING, stamps(), np.ones((400, 2)), omega, ROBOT) is None


@pytest.mark.parametrize(('lost', 'complete'), [(0.0, True), (0.04, False), (9.0, None)])
def test_a_crossing_with_a_lost_batch_is_not_complete(lost, complete):
    kept = np.abs(stamps() - EPOCH) >= 0.5 * lost * NS_PER_S
    found = crossing_waveform(CROSSING, stamps()[kept], np.ones((400, 2))[kept], OMEGA, ROBOT)
    assert getattr(found, 'complete', None) is complete


def test_of_several_groups_the_films_with_a_signal_are_those_of_the_crossing():
    robot = build(RobotParams, {
        'film.positions': [0.0, 0.03, 0.27, 0.3], 'film.stretch_gain': [307.5] * 4,
        'film.bending_peak': [0.8] * 4})
    volts = np.full((400, 4), 1.6)
    volts[:, 2:] = np.column_stack([voltages(-0.015), voltages(0.015)])
    found = crossing_waveform(CROSSING, stamps(), volts, OMEGA, robot)
    assert [film.film for film in found.films] == [2, 3]
