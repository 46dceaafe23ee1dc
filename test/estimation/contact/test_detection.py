# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Coarse detection: the center to a fraction of a millimeter, and no false detections."""

from benchmarks.friction.grid import Case
from benchmarks.friction.synthesis import CrossingSynthesizer
import numpy as np
import pytest
from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.models.tire import tread_film
from smart_tire.parameters import build, RobotParams
from support.crossings import crossing_samples, WHEEL

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
BENDING, GAIN = ROBOT.film.bending(WHEEL)[0], ROBOT.film.gains(WHEEL)[0]


def detect(distance, volts, robot=ROBOT, between=(-0.02, 0.02)):
    return CrossingDetector(robot).detect(
        distance, volts, bending=BENDING, gain=GAIN, between=between)


def first_film(seed):
    return crossing_samples(
        np.random.default_rng(seed), ROBOT, slip=0.1, normalized_slip=0.2).films[0]


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('rpm', [15.0, 60.0, 200.0])
@pytest.mark.parametrize('slip', [0.0, 0.05, 0.2, -0.05, -0.3])
def test_a_crossing_is_detected_at_its_center(slip, rpm, release):
    robot = build(RobotParams, {'film.release': release, 'film.noise': 0.01})
    rng = np.random.default_rng(0)
    for _ in range(3):
        detections = crossing_samples(rng, robot, slip=slip, normalized_slip=1.5 * abs(slip),
                                      rpm=rpm).detections
        for i, detection in enumerate(detections):
            assert detection.center == pytest.approx(i * 0.03, abs=2e-3)
            assert detection.slip == pytest.approx(slip, abs=0.3 * abs(slip) + 0.07)
            assert detection.bending == pytest.approx(robot.film.bending(WHEEL)[i], rel=0.3)
            assert detection.coverage > 0.75  # clipped samples do not count


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('share', [0.3, 0.5, 0.7])
@pytest.mark.parametrize('slip', [0.05, 0.3, -0.1, -0.3])
def test_a_crossing_with_a_release_between_the_conventions_is_detected(slip, share, release):
    source = CrossingSynthesizer(Case(slip=slip, release=release, release_share=share), 2)
    for _ in range(3):
        samples = source.crossing().samples
        assert [film.film for film in samples.films] == [0, 1]
        for detection, center in zip(samples.detections, (0.0, 0.03)):
            assert detection.center == pytest.approx(center, abs=3e-3)


def test_lost_samples_reduce_the_coverage():
    film = first_film(1)
    kept = (film.distance < -0.005) | (film.distance > 0.015)
    assert detect(film.distance[kept], film.volts[kept]).coverage == pytest.approx(0.7, abs=0.06)


@pytest.mark.parametrize('make', [
    lambda x, rng: rng.normal(0.0, 0.02, len(x)),
    lambda x, rng: -0.12 * tread_film.bumps(x, FILM, L)[0],
    lambda x, rng: np.where(np.abs(x) < 0.002, 1.2, 0.0),
    lambda x, rng: np.full(len(x), 0.8),
], ids=['noise', 'bumps', 'spike', 'constant'])
def test_other_signals_are_not_detected_as_a_crossing(make):
    rng = np.random.default_rng(5)
    distance = np.arange(-0.045, 0.075, 0.0027)
    volts = make(distance + 0.5 * (L - FILM), rng) + rng.normal(0.0, 0.005, len(distance))
    assert detect(distance, volts) is None


def test_a_crossing_outside_the_search_range_is_not_detected():
    film = first_film(2)
    assert detect(film.distance, film.volts, between=(0.03, 0.05)) is None


def test_too_few_samples_are_not_detected_as_a_crossing():
    film = first_film(3)
    assert detect(film.distance[40:45], film.volts[40:45]) is None
