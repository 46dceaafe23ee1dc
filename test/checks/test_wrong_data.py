# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.


"""Wrong units, axes, signs and clocks: the cause is named, and nothing else."""

from __future__ import annotations

from benchmarks.wrong_data import found_in, judged, RIGHT, SILENT, VARIANTS, WRONG
import pytest
from smart_tire.bags import Bag
from smart_tire.checks.recording import READ
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import TreadFilmParams
from support.checked import clean, DRIVE
from support.real_recordings import real_recording

ROBOT = RobotParams(film=TreadFilmParams(wheels=()))
WARTHOG = RobotParams(wheel_radius=0.30, track_width=1.08, wheelbase=0.8, mass=250.0,
                      film=TreadFilmParams(wheels=()))
SHORT = (
    'none', 'gyro in deg/s', 'accelerometer in g', 'accelerometer in cm/s2', 'gravity removed',
    'wheel speeds in m/s', 'wheel speeds in rpm', 'velocities in rpm, positions in rad',
    'IMU turned by 90 degrees', 'y right, z down', 'IMU on its front', 'gyro z reversed',
    'sides swapped', 'right wheels reversed', 'all wheels reversed', 'one wheel reversed',
    'one wheel stuck', 'mean of the sides', 'torques reversed', 'radius in mm',
    'half of the radius', 'IMU 0.8 m to the left', 'wheels late by 0.2 s', 'wheels early by 2 s',
    'no stamps of the IMU', 'second half')


def result(name, events, robot, before=()):
    """Return what is said about a variant, and the findings."""
    variant = VARIANTS[name]
    found = found_in(variant.change(events, robot), variant.setting(robot))
    return judged(variant, found, before), '\n'.join(one.text for one in found)


@pytest.mark.parametrize('name', [
    name if name in SHORT else pytest.param(name, marks=pytest.mark.long) for name in VARIANTS])
def test_the_cause_is_named_on_concrete(name):
    said, text = result(name, clean(1, 'concrete', DRIVE, 16.0, ROBOT), ROBOT)
    assert said == RIGHT, text


@pytest.mark.long
@pytest.mark.parametrize('name', VARIANTS)
def test_the_cause_is_named_on_sand(name):
    said, text = result(name, clean(3, 'sand', DRIVE, 16.0, ROBOT), ROBOT)
    assert said == RIGHT, text


@pytest.mark.long
def test_nothing_wrong_is_said_of_a_real_recording():
    with Bag(real_recording('warthog_gravel_0')) as opened:
        events = list(opened.samples(READ, restamp=False))
    before = found_in(events, WARTHOG)
    said = {name: result(name, events, WARTHOG, before) for name in VARIANTS}
    assert [found for found in said.items() if found[1][0] == WRONG] == []
    assert sum(found == RIGHT for found, _ in said.values()) >= 38


def test_a_finding_is_right_silent_or_wrong():
    variant = VARIANTS['gyro in deg/s']
    blamed = found_in((), RobotParams())  # no messages
    assert judged(variant, blamed) == WRONG
    assert judged(variant, ()) == SILENT
    assert judged(variant, blamed, blamed) == SILENT
