# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Buckled film as a sensor: its constants, both normalizations, and charge from deflection."""

from dataclasses import replace

from hypothesis import given, strategies as st
import numpy as np
import pytest

from smart_tire.errors import ParameterError
from smart_tire.models.film import elastica
from smart_tire.models.film.buckling_film import BucklingFilm, FILMS, Material

TABLE_I_FILM = FILMS['25x3']


def test_the_gain_of_table_i_is_a_hundred_times_the_papers_formula():
    # 2 pi^2 d31 c11 b t^2 / (12 L) by hand, for 25 mm x 3 mm x 110 um
    by_hand = 2.0 * np.pi**2 * 23e-12 * 3e9 * 0.003 * 110e-6**2 / (12.0 * 0.0125)
    assert TABLE_I_FILM.gain == pytest.approx(by_hand, rel=1e-12)
    assert 90.0 < 34.47e-9 / TABLE_I_FILM.gain < 110.0


def test_the_weights_of_the_papers_films_are_small():
    weights = {name: film.weight for name, film in FILMS.items()}
    # 12 rho g L^3 / (E t^2) with rho = 1780 kg/m3, E = 3 GPa
    assert weights == pytest.approx({'25x3': 0.01127, '32x3': 0.02364, '10x1': 0.01113}, rel=1e-3)


def test_each_half_film_has_half_of_the_end_displacement():
    exact, printed = TABLE_I_FILM, replace(TABLE_I_FILM, convention='printed')
    assert exact.stroke(0.0025) == pytest.approx(0.1)
    assert printed.stroke(0.0025) == pytest.approx(0.2)
    # A(8b): the distance of the clamps is 2 L minus the deflection
    shape = elastica.shape(exact.stroke(0.0025), 1.0)
    assert 2.0 * exact.half_length * float(shape.x) == pytest.approx(0.025 - 0.0025)


@given(st.floats(0.0, 0.0249), st.sampled_from(['25x3', '32x3']))
def test_the_deflection_from_the_charge_is_the_deflection(deflection, name):
    film = FILMS[name]
    assert film.deflection(film.stroke(deflection)) == pytest.approx(deflection, rel=1e-14)
    back = film.deflection_from_charge(film.normalized_charge(deflection))
    assert back == pytest.approx(deflection, rel=1e-9, abs=1e-17)


def test_the_models_agree_for_small_strokes_and_differ_for_large_ones():
    small, large = 1e-5, 0.012
    charges = {model: TABLE_I_FILM.normalized_charge([small, large], model)
               for model in ('exact', 'printed', 'linear', 'arched', 'hanging')}
    for model in ('printed', 'linear'):
        assert charges[model][0] == pytest.approx(charges['exact'][0], rel=1e-3)
        assert abs(charges[model][1] / charges['exact'][1] - 1.0) > 0.05
    # the weight matters below a stroke of 0.05 only
    assert abs(charges['arched'][0] - charges['exact'][0]) > abs(charges['exact'][0])
    assert charges['arched'][1] == pytest.approx(charges['exact'][1], rel=2e-3)
    assert charges['hanging'][0] < charges['exact'][0] < charges['arched'][0]


@pytest.mark.parametrize('change, message', [
    ({'length': 0.0}, 'length is 0'), ({'thickness': float('nan')}, 'thickness is nan'),
    ({'width': -1.0}, 'width is -1'), ({'convention': 'half'}, "convention is 'half'")])
def test_invalid_films_are_rejected(change, message):
    with pytest.raises(ParameterError, match=message):
        replace(TABLE_I_FILM, **change)


def test_invalid_materials_models_and_deflections_are_rejected():
    with pytest.raises(ParameterError, match='density is inf'):
        Material(density=float('inf'))
    with pytest.raises(ParameterError, match="model is 'best'.*hanging"):
        TABLE_I_FILM.normalized_charge(0.001, 'best')
    with pytest.raises(ParameterError, match='stretched'):
        TABLE_I_FILM.normalized_charge(-1e-6)
    with pytest.raises(ParameterError, match='clamps have met'):
        BucklingFilm(length=0.01, width=0.001, thickness=28e-6).stroke(0.01)
