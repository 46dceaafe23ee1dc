"""A first look: the place to a fraction of a millimetre, and nothing that is no passage."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.models.tire import tread_film
from smart_tire.parameters import build, RobotParams
from support.passages import passage, WHEEL

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
BENDING, GAIN = ROBOT.film.bending(WHEEL)[0], ROBOT.film.gains(WHEEL)[0]


def look(distance, volts, robot=ROBOT, between=(-0.02, 0.02)):
    return CrossingDetector(robot).look(
        distance, volts, bending=BENDING, gain=GAIN, between=between)


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('rpm', [15.0, 60.0, 200.0])
@pytest.mark.parametrize('slip', [0.0, 0.05, 0.2, -0.05, -0.3])
def test_a_passage_is_seen_where_it_is(slip, rpm, release):
    robot = build(RobotParams, {'film.release': release, 'film.noise': 0.01})
    rng = np.random.default_rng(0)
    for _ in range(10):
        seen = passage(rng, robot, slip=slip, sliding=1.5 * abs(slip), rpm=rpm).sightings
        for i, one in enumerate(seen):
            assert one.middle == pytest.approx(i * 0.03, abs=2e-3)
            assert one.slip == pytest.approx(slip, abs=0.3 * abs(slip) + 0.07)
            assert one.bending == pytest.approx(robot.film.bending(WHEEL)[i], rel=0.3)
            assert one.coverage > 0.75  # clipped samples are not counted


def test_lost_samples_are_not_covered():
    film = passage(np.random.default_rng(1), ROBOT, slip=0.1, sliding=0.2).films[0]
    kept = (film.distance < -0.005) | (film.distance > 0.015)
    assert look(film.distance[kept], film.volts[kept]).coverage == pytest.approx(0.7, abs=0.06)


@pytest.mark.parametrize('make', [
    lambda x, rng: rng.normal(0.0, 0.02, len(x)),
    lambda x, rng: -0.12 * tread_film.bumps(x, FILM, L).value,
    lambda x, rng: np.where(np.abs(x) < 0.002, 1.2, 0.0),
    lambda x, rng: np.full(len(x), 0.8),
], ids=['noise', 'bumps', 'spike', 'constant'])
def test_what_is_no_passage_is_not_seen(make):
    rng = np.random.default_rng(5)
    distance = np.arange(-0.045, 0.075, 0.0027)
    volts = make(distance + 0.5 * (L - FILM), rng) + rng.normal(0.0, 0.005, len(distance))
    assert look(distance, volts) is None


def test_a_passage_far_from_where_it_is_looked_for_is_not_seen_there():
    film = passage(np.random.default_rng(2), ROBOT, slip=0.1, sliding=0.2).films[0]
    assert look(film.distance, film.volts, between=(0.03, 0.05)) is None


def test_too_few_samples_are_no_passage():
    film = passage(np.random.default_rng(3), ROBOT, slip=0.1, sliding=0.2).films[0]
    assert look(film.distance[40:45], film.volts[40:45]) is None
