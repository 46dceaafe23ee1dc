# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Models as objects: film of paper A, tire and film in the tread of paper B."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire import BrushTire, FilmSensor, load_params, TreadFilm
from smart_tire.errors import ParameterError


def swept(rate: float = 1000.0) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and deflections [m] of two periods from flat."""
    time = np.arange(0.0, 2.0, 1.0 / rate)
    return time, 0.00125 * (1.0 - np.cos(2.0 * np.pi * time))


def test_a_measurement_inverts_the_charge():
    time, deflection = swept()
    measured = FilmSensor().measure(time, FilmSensor().charge(deflection))
    np.testing.assert_allclose(measured.value, deflection, atol=1e-9)


def test_the_charge_has_hysteresis_with_the_loop_of_table_i():
    time, deflection = swept()
    charge = FilmSensor().charge(deflection)
    up, down = charge[1250], charge[1750]  # equal deflections of the second period
    assert deflection[1250] == pytest.approx(deflection[1750])
    assert abs(up - down) > 0.05 * np.ptp(charge)


def test_a_used_film_is_less_certain():
    time, deflection = swept()
    charge = FilmSensor().charge(deflection)
    fresh, used = (FilmSensor().measure(time, charge, used=used) for used in (False, True))
    assert np.median(used.sigma) > 10.0 * np.median(fresh.sigma)


def test_a_file_that_is_no_film_is_refused(tmp_path):
    (tmp_path / 'film.yaml').write_text('a: 1')
    with pytest.raises(ParameterError, match='film is missing'):
        FilmSensor.load(tmp_path / 'film.yaml')


def test_friction_from_adhesion_inverts_the_brush_model():
    tire = BrushTire(stiffness=80.0, load=40.0)
    ratio = tire.adhesion_ratio(0.1, [0.2, 0.5])
    np.testing.assert_allclose(tire.friction(ratio, 0.1), [0.2, 0.5])
    np.testing.assert_allclose(tire.critical_slip(0.4), 3.0 * 0.4 * 40.0 / 80.0)


def test_the_force_of_a_sliding_tire_is_friction_times_load():
    force = BrushTire().force(2.0, 0.0, 0.5)
    np.testing.assert_allclose(force, (0.5 * 26.7, 0.0))


def test_without_slip_the_film_only_bends():
    film = TreadFilm(bending_peak=0.5)
    volts = film.voltage([-0.03, 0.01, 0.046], slip=0.0, critical_slip=0.7)
    np.testing.assert_allclose(volts, [0.0, 0.5, -0.5], atol=1e-12)


def test_lateral_slip_enlarges_the_sliding_zone():
    film = TreadFilm()
    straight, turning, same = (
        film.voltage(0.022, slip=0.1, critical_slip=0.7, total_slip=total)
        for total in (None, 0.4, 0.1))
    assert straight == same and film.bending_peak < turning < straight


def test_a_film_of_the_robot_has_its_gain():
    params = load_params(values={'film.wheels': ['front_left'], 'film.length': 0.018,
                                 'film.release': 'state'})
    first, second = (TreadFilm.of(params, 'front_left', film) for film in (0, 1))
    assert (first.stretch_gain, second.stretch_gain) == (307.5, 242.5)
    assert first.length == 0.018 and first.release == 'state'
    assert second.bending_peak == params.robot.film.bending('front_left')[1]
    with pytest.raises(ParameterError, match='film is '):
        TreadFilm.of(params, 'front_left', 2)
    with pytest.raises(ParameterError, match='wheel is '):
        TreadFilm.of(params, 'left')


@pytest.mark.parametrize('kind, name, value', [
    (BrushTire, 'stiffness', 0.0), (BrushTire, 'load', -1.0), (TreadFilm, 'length', 0.0),
    (TreadFilm, 'contact_length', -0.1), (TreadFilm, 'bending_alpha', 0.0),
    (TreadFilm, 'recovery', 0.0), (TreadFilm, 'release', 'fig9')])
def test_a_tire_or_film_that_cannot_be_is_refused(kind, name, value):
    with pytest.raises(ParameterError, match=name):
        kind(**{name: value})
