# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Crossings of a whole recording with the slip in each, from samples as received."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest
from smart_tire.calibration.film_crossings import CrossingCollector
from smart_tire.calibration.film_gains import identify_gains
from smart_tire.samples import TireSample, WheelSample
from support.identifying import assert_agrees
from support.rolling import (
    along, films, in_order, passes, PLACE, ROBOT, slips, stamp, steady, WHEEL, wheels)

WINDOW = 0.06   # s
DURATION = 7.0  # s
TRAJECTORY = steady(60.0)
REVERSING = along([(0.5, 0.0), (6.0, 3.0), (6.3, 3.0), (12.0, 0.0)])
ANGLE = (PLACE - 0.5 * ROBOT.film.spacing) / ROBOT.wheel_radius  # rad, of film 1


def collected(samples, given, robot=ROBOT):
    collector = CrossingCollector(robot, WINDOW)
    for sample in samples:
        collector.update(sample)
    return list(collector.with_slip(given)), collector


def rolled(trajectory=TRAJECTORY, duration=DURATION, **options):
    return (in_order(films(trajectory, duration, **options), wheels(trajectory, duration)),
            slips(trajectory, duration, slip=options.get('slip', 0.1)))


@pytest.fixture(scope='module')
def turns():
    """Return samples of a few revolutions of a wheel, and its slips."""
    return rolled()


def test_each_crossing_has_its_slip(turns):
    crossings, _ = collected(*turns)
    expected = [t for t in passes(TRAJECTORY, DURATION) if t < DURATION - 0.3]
    assert [one.stamp_ns for one in crossings] == pytest.approx(
        [stamp(t) for t in expected], abs=5e6)
    for one in crossings:
        assert one.slip == pytest.approx((0.1, 0.003))
        assert one.wheel == WHEEL
        assert [film.film for film in one.films.films] == [0, 1]
        assert one.deviation < 0.002


def test_repeated_foreign_and_impossible_samples_are_ignored(turns):
    samples, given = turns
    crossings, clean = collected(samples, given)
    spoiled = []
    for sample in samples:
        spoiled += [sample, sample]
        if isinstance(sample, TireSample):
            spoiled += [replace(sample, wheel='rear_left'),
                        replace(sample, stamp_ns=sample.stamp_ns + 1, volts=(math.nan, 0.0))]
        elif isinstance(sample, WheelSample):
            spoiled.append(replace(sample, stamp_ns=sample.stamp_ns + 1, velocity=(1e9,) * 4))
    again, collector = collected(spoiled, given)
    assert [one.stamp_ns for one in again] == [one.stamp_ns for one in crossings]
    assert collector.tire_samples == clean.tire_samples


def test_crossings_without_slip_are_left_out(turns):
    samples, given = turns
    half = [slip for slip in given if slip.stamp_ns < stamp(0.5 * DURATION)]
    crossings, _ = collected(samples, half)
    assert crossings
    assert all(one.stamp_ns < stamp(0.5 * DURATION) + 50_000_000 for one in crossings)
    assert not collected(samples, [])[0]


def test_without_wheel_positions_the_angle_of_a_crossing_is_unknown(turns):
    samples, given = turns
    bare = [replace(one, position=None) if isinstance(one, WheelSample) else one
            for one in samples]
    assert all(math.isnan(one.origin) for one in collected(bare, given)[0])


@pytest.mark.parametrize(('release', 'slip'), [('fig8', 0.1), ('state', -0.1)])
def test_gains_lengths_and_angle_of_a_nominal_robot_are_the_nominal_ones(turns, release, slip):
    robot = replace(ROBOT, film=replace(ROBOT.film, release=release))
    run = turns if slip > 0.0 else rolled(slip=slip, release=release)
    crossings, _ = collected(*run, robot)
    found = identify_gains([crossings], robot)
    for one, gain in zip(found.films, robot.film.stretch_gain):
        assert one.gain.value == pytest.approx(gain, abs=min(2.0 * one.gain.sigma, 0.03 * gain))
    assert_agrees(found.length, robot.tire.contact_length, 2.0)
    assert_agrees(found.places[1], robot.film.spacing, 2.0)
    assert_agrees(found.angles[0, WHEEL], ANGLE)


def test_backward_crossings_are_used():
    duration = 12.5
    forward = [one for one in rolled(REVERSING, duration)[0] if one.stamp_ns < stamp(6.15)]
    samples, given = rolled(REVERSING, duration, reverse=True)
    backward = [one for one in samples if one.stamp_ns >= stamp(6.15)]
    crossings, _ = collected(forward + backward, given)
    assert {one.direction for one in crossings} == {1, -1}
    found = identify_gains([crossings], ROBOT)
    angle = found.angles[0, WHEEL]
    assert angle.value == pytest.approx(ANGLE, abs=max(3.0 * angle.sigma, 0.004))
    assert_agrees(found.places[1], ROBOT.film.spacing)
