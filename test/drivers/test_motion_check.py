# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Check of the encoders in closed loop: every fault is found in time, and no drive is stopped."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.cases import long
from support.encoder_faults import Drive, Fault, GROUNDS, other_robot, random_drive

pytestmark = pytest.mark.slow

CASES = pytest.mark.parametrize('cases', [range(2), *long(range(2, 20))], ids=['few', 'many'])
LATENCY = 0.05  # s from a trip to zero duty at the motors, at most


def robot_of(case):
    """Return the configured robot, or one whose motors differ by up to 20 %."""
    return other_robot(case) if case % 2 else None


def found_after(case, kind, speed, **options):
    """Return the time [s] from a fault at a random phase to its trip, inf if it is missed."""
    rng = np.random.default_rng([case, 5])
    begin, wheel = 1.5 + rng.uniform(), int(rng.integers(4))
    speed = rng.uniform(*speed) * rng.choice((-1.0, 1.0))
    trip = Drive(lambda now: (speed, 0.0), seed=case, robot=robot_of(case),
                 fault=Fault(kind, wheel, begin), **options).first_trip(begin + 1.5)
    if trip is None:
        return math.inf
    assert trip[0] > begin
    assert trip[1] == wheel
    return trip[0] - begin


SLOW, ANY = (0.1, 0.1), (0.1, 1.4)  # m/s


@CASES
@pytest.mark.parametrize(('kind', 'speed', 'currents'), [
    (kind, speed, currents) for kind in ('frozen', 'toggling', 'reversed')
    for speed in (SLOW, ANY) for currents in (True, False)
    if currents or kind != 'reversed' or speed != SLOW])
def test_an_encoder_that_stops_counting_or_reverses_is_found_within_half_a_second(
        kind, speed, currents, cases):
    assert max(found_after(case, kind, speed, currents=currents)
               for case in cases) < 0.5 - LATENCY


@CASES
@pytest.mark.parametrize('speed', [SLOW, ANY], ids=['slow', 'any'])
@pytest.mark.parametrize('currents', [True, False], ids=['currents', 'no currents'])
def test_an_encoder_that_loses_four_of_five_counts_is_found_within_a_second(
        speed, currents, cases):
    assert max(found_after(case, 'losing', speed, currents=currents)
               for case in cases) < 1.0 - LATENCY


@CASES
@pytest.mark.parametrize('kind', ['frozen', 'toggling'])
def test_a_fault_is_found_in_open_loop_at_a_low_duty(kind, cases):
    for case in cases:
        begin = 1.5 + 0.05 * case
        trip = Drive(duty=(0.15,) * 4, seed=case, fault=Fault(kind, case % 4, begin),
                     robot=robot_of(case)).first_trip(begin + 1.0)
        assert trip
        assert 0.0 < trip[0] - begin < 0.5 - LATENCY


@pytest.mark.parametrize('currents', [True, False], ids=['currents', 'no currents'])
@pytest.mark.parametrize(('surface', 'cases'), [
    ('concrete', range(1)), *long(*((surface, range(10)) for surface in GROUNDS))])
def test_no_drive_is_stopped(surface, cases, currents):
    for case in cases:
        assert Drive(random_drive(case, 20.0), surface=surface, seed=case, robot=robot_of(case),
                     currents=currents).trips(20.0) == []


@pytest.mark.parametrize(('cases', 'seconds', 'options'), [
    (1, 10.0, {'slope': math.radians(8.0)}), *long(
        *((3, 10.0, {'rate': rate}) for rate in (50.0, 100.0, 200.0)),
        (6, 20.0, {'braking_currents': False}),  # the boards report none
        *((5, 20.0, {'slope': math.radians(degrees)}) for degrees in (-8.0, 8.0)))])
def test_no_drive_is_stopped_in_other_conditions(cases, seconds, options):
    for case in range(cases):
        robot = robot_of(case) if 'slope' in options else None
        assert Drive(random_drive(case, seconds), seed=case, robot=robot,
                     **options).trips(seconds) == []


def test_a_robot_held_on_a_slope_is_not_stopped():
    assert Drive(duty=(0.065,) * 4, slope=math.radians(8.0)).trips(5.0) == []


def test_a_toggling_encoder_at_rest_is_not_a_fault():
    for wheel in range(4):
        assert Drive(lambda now: (0.0, 0.0), fault=Fault('toggling', wheel, 0.5)).trips(3.0) == []
