"""What is identified of tires, as parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.gains import recording

from smart_tire.analysis.calibrate_tire import gain_parameters
from smart_tire.calibration.film.gains import identify_gains
from smart_tire.parameters import build, RobotParams
from smart_tire.parameters.calibration_file import identified_text

NOMINAL = RobotParams()
WHEELS = ('front_left', 'front_right')


def parameters(found, given):
    return {item.name: item for item in gain_parameters(found, given)}


def test_a_film_that_was_not_told_stays_as_it_was_and_is_named():
    given = replace(NOMINAL, film=replace(NOMINAL.film, wheels=WHEELS))
    rng = np.random.default_rng(1)
    found = identify_gains([[*recording(rng, NOMINAL, films=(0,), wheel='front_left'),
                             *recording(rng, NOMINAL)]], given)
    told = parameters(found, given)
    gains = told['film.stretch_gain']
    assert len(gains.value) == 4
    assert gains.value[1] == NOMINAL.film.stretch_gain[1]
    assert gains.note == 'film 2 of front_left as it was'
    assert told['film.stretch_gain_tolerance'].value == pytest.approx(
        max(sigma / value for value, sigma in zip(gains.value, gains.sigma)))
    build(RobotParams, {name: item.value for name, item in told.items()}
          | {'film.wheels': list(WHEELS)})
    assert 'contact_length' in identified_text([], told.values())


def test_lengths_are_written_where_slip_tells_no_gains():
    found = identify_gains([recording(np.random.default_rng(2), NOMINAL, turns=(0.003, -0.004))],
                           NOMINAL)
    told = parameters(found, NOMINAL)
    assert set(told) == {'film.bending_peak', 'film.spacing', 'tire.contact_length'}


def test_films_with_positions_get_positions():
    given = replace(NOMINAL, film=replace(NOMINAL.film, positions=(0.01, 0.04)))
    told = parameters(identify_gains([recording(np.random.default_rng(3), NOMINAL)], given), given)
    assert told['film.positions'].value == pytest.approx((0.01, 0.04), abs=4e-4)
    assert 'film.spacing' not in told
