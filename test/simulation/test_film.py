# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The simulated film: motion, heat, saturation and the bytes of its amplifier."""

import numpy as np
import pytest
from smart_tire.drivers.sample_stream import FILM_CHARGE, SampleStream
from smart_tire.models.film.hysteresis import respond
from smart_tire.parameters.film import FilmSimulatorParams
from smart_tire.simulation.film import MOTION, SimulatedFilm, START_TEMPERATURE

QUIET = {'loss': 0.0, 'rest': 0.5, 'frequency': 2.0}


def instants(seconds, **params):
    film = SimulatedFilm(FilmSimulatorParams(**params))
    return film, [film.next_instant() for _ in range(round(500.0 * seconds))]


def test_the_charge_is_that_of_the_operator_within_noise_and_drain():
    film, found = instants(2.0, **QUIET)
    path = np.array([one.deflection for one in found])
    assert (path[:250] == 0.0).all() and path.max() == pytest.approx(0.012)
    expected = respond(film.stand.charge(path), film.stand.hysteresis)
    charge = np.array([one.charge.charge for one in found])
    noise = 0.02e-9
    assert np.std(charge - expected) < 3.0 * noise
    assert np.std(charge[:250]) == pytest.approx(noise, rel=0.2)


def test_heat_adds_charge_in_steps():
    cold, warm = (instants(14.0, **QUIET, warming=heat)[1][-1] for heat in (0.0, 2.0))
    rise = 2.0 * (1.0 - np.exp(-(14.0 - MOTION) / 2.0))
    assert warm.temperature == pytest.approx(START_TEMPERATURE + rise, abs=0.01)
    per_kelvin = -27e-6 * 0.025 * 0.003
    assert warm.charge.charge - cold.charge.charge == pytest.approx(per_kelvin * rise, rel=0.05)


def test_the_device_sends_what_it_has_measured_and_flags_the_limit():
    film, found = instants(14.0, **QUIET, warming=50.0)
    stream = SampleStream(FILM_CHARGE)
    received = [sample for one in found
                for sample in stream.receive(one.frame, 10**18 + one.time_ns)]
    assert len(received) == len(found) and stream.frames_bad == stream.bytes_skipped == 0
    assert [one.charge.saturated for one in found] == [one.saturated for one in received]
    assert any(one.saturated for one in received)
    assert max(abs(one.charge) for one in received) <= film.stand.full_scale * 1.0001
    np.testing.assert_allclose([one.charge for one in received],
                               [one.charge.charge for one in found], atol=6e-14)


def test_frames_are_lost_by_their_share():
    _, found = instants(4.0, **{**QUIET, 'loss': 0.2})
    assert np.mean([one.frame == b'' for one in found]) == pytest.approx(0.2, abs=0.04)
