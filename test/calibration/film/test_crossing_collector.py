"""Passages of a whole recording with the slip in each, from samples as they are received."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest
from support.rolling import (
    along, films, in_order, passes, PLACE, ROBOT, stamp, steady, surroundings, WHEEL)

from smart_tire.calibration.film.crossing_collector import PassageCollector
from smart_tire.calibration.film.gains import identify_gains
from smart_tire.samples import TireSample, WheelSample, WheelSlip

WINDOW = 0.06   # s
DURATION = 7.0  # s
COURSE = steady(60.0)
BACK = along([(0.5, 0.0), (6.0, 3.0), (6.3, 3.0), (12.0, 0.0)])
ANGLE = (PLACE - 0.5 * ROBOT.film.spacing) / ROBOT.wheel_radius  # rad, of film 1


def collected(samples, slips, robot=ROBOT):
    collector = PassageCollector(robot, WINDOW)
    for sample in samples:
        if isinstance(sample, (TireSample, WheelSample)):
            collector.update(sample)
    return list(collector.known(slip for slip in slips if isinstance(slip, WheelSlip))), collector


def rolled(course=COURSE, duration=DURATION, positions=True, **options):
    around = surroundings(course, duration, positions=positions,
                          **{key: options[key] for key in options if key in ('slip', 'total')})
    return in_order(films(course, duration, **options), around), around


@pytest.fixture(scope='module')
def turns():
    """Return samples of a few turns of a wheel, and its slips."""
    return rolled()


def test_each_passage_comes_with_the_slip_in_it(turns):
    known, _ = collected(*turns)
    expected = [t for t in passes(COURSE, DURATION) if t < DURATION - 0.3]
    assert [one.stamp_ns for one in known] == pytest.approx(
        [stamp(t) for t in expected], abs=5e6)
    for one in known:
        assert one.slip == pytest.approx((0.1, 0.003))
        assert one.wheel == WHEEL
        assert [film.film for film in one.films.films] == [0, 1]
        assert one.stray < 0.002


def test_repeated_foreign_and_impossible_samples_change_nothing(turns):
    samples, slips = turns
    known, clean = collected(samples, slips)
    spoiled = []
    for sample in samples:
        spoiled += [sample, sample]
        if isinstance(sample, TireSample):
            spoiled += [replace(sample, wheel='rear_left'),
                        replace(sample, stamp_ns=sample.stamp_ns + 1, volts=(math.nan, 0.0))]
        elif isinstance(sample, WheelSample):
            spoiled.append(replace(sample, stamp_ns=sample.stamp_ns + 1, velocity=(1e9,) * 4))
    again, collector = collected(spoiled, slips)
    assert [one.stamp_ns for one in again] == [one.stamp_ns for one in known]
    assert collector.tire_samples == clean.tire_samples


def test_passages_without_slip_are_not_known(turns):
    samples, slips = turns
    half = [slip for slip in slips if slip.stamp_ns < stamp(0.5 * DURATION)]
    known, _ = collected(samples, half)
    assert known
    assert all(one.stamp_ns < stamp(0.5 * DURATION) + 50_000_000 for one in known)
    assert not collected(samples, [])[0]


@pytest.mark.parametrize('positions', [True, False])
def test_positions_of_the_wheel_tell_where_film_1_sits(turns, positions):
    known, _ = collected(*(turns if positions else rolled(positions=False)))
    found = identify_gains([known], ROBOT)
    if not positions:
        assert all(math.isnan(one.origin) for one in known)
        assert 'positions' in found.refused[f'angle of film 1, {WHEEL}']
        return
    angle = found.angles[0, WHEEL]
    assert angle.value == pytest.approx(ANGLE, abs=3.0 * angle.sigma)


@pytest.mark.parametrize(('release', 'slip'), [('fig8', 0.1), ('state', -0.1)])
def test_gains_and_lengths_of_a_robot_that_is_as_told_are_as_told(release, slip):
    robot = replace(ROBOT, film=replace(ROBOT.film, release=release))
    known, _ = collected(*rolled(slip=slip, release=release), robot)
    found = identify_gains([known], robot)
    for one, gain in zip(found.films, robot.film.stretch_gain):
        assert one.gain.value == pytest.approx(gain, abs=min(2.0 * one.gain.sigma, 0.03 * gain))
    assert found.length.value == pytest.approx(robot.tire.contact_length,
                                               abs=2.0 * found.length.sigma)
    assert found.places[1].value == pytest.approx(robot.film.spacing,
                                                  abs=2.0 * found.places[1].sigma)


def test_passages_backward_are_passages_too():
    duration = 12.5
    forth = [one for one in rolled(BACK, duration)[0] if one.stamp_ns < stamp(6.15)]
    samples, slips = rolled(BACK, duration, reverse=True)
    known, _ = collected(forth + [one for one in samples if one.stamp_ns >= stamp(6.15)], slips)
    assert {one.direction for one in known} == {1, -1}
    found = identify_gains([known], ROBOT)
    angle = found.angles[0, WHEEL]
    assert angle.value == pytest.approx(ANGLE, abs=max(3.0 * angle.sigma, 0.004))
    assert found.places[1].value == pytest.approx(ROBOT.film.spacing,
                                                  abs=3.0 * found.places[1].sigma)
