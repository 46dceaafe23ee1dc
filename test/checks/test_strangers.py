# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings of other robots: doctor names the cause, and analyze is right or says that not."""

from __future__ import annotations

from benchmarks.strangers import (
    ALL, combined, DRIVE, EQUIVALENT, PAIRS, result, rotations, turned)
from benchmarks.wrong_data import CHANGED, found_in, RIGHT, Variant
import numpy as np
import pytest
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.rotation import matrix
from support.checked import clean

ROBOT = RobotParams(film=TreadFilmParams(wheels=()))
SHORT = (
    'rear wheels swapped', 'front_right reversed', 'gyro not measured', 'IMU stuck for 3 s',
    'gyro saturated', 'two IMUs', 'clock set back by 2 s', 'clock set forward by an hour',
    'simulated time, received before /clock', 'both with covariance -1',
    'angles in revolutions, rpm', 'angles in degrees, m/s', 'angles in rad, ticks/s',
    'angles in rad, rad/s of the opposite sign', 'IMU 1 m behind',
    'milliseconds in nanosec', 'angles wrapped at pi, no velocities', 'velocities always zero')


@pytest.fixture(scope='module')
def events():
    """Return a drive with turns, starts and stops."""
    return [event for event in clean(1, 'concrete', DRIVE, 16.0, ROBOT) if event[1] in CHANGED]


@pytest.fixture(scope='module')
def before(events):
    """Return what is found in the drive itself."""
    return result(events, ROBOT, Variant(), [], doors=False).found


@pytest.fixture(scope='module')
def reference(events, before):
    """Return the estimate of the drive itself."""
    return result(events, ROBOT, Variant(), before)


def texts(one):
    return '\n'.join(finding.text for finding in one.found)


@pytest.mark.parametrize('name', SHORT)
def test_the_cause_is_named(name, events, before):
    one = result(events, ROBOT, ALL[name], before, doors=False)
    assert one.doctor == RIGHT, texts(one)


@pytest.mark.long
@pytest.mark.parametrize('name', ALL)
def test_no_wrong_estimate_is_without_an_error(name, events, before, reference):
    one = result(events, ROBOT, ALL[name], before)
    assert one.doctor == RIGHT, texts(one)
    assert one.right(reference), one.distance(reference)


@pytest.mark.parametrize('names', [
    pair if pair == PAIRS[10] else pytest.param(pair, marks=pytest.mark.long)
    for pair in PAIRS if pair not in EQUIVALENT], ids=' + '.join)
def test_both_causes_are_named(names, events, before):
    one = result(events, ROBOT, combined(*map(ALL.get, names)), before, doors=False)
    assert one.doctor == RIGHT, texts(one)


@pytest.mark.parametrize('axes', [
    axes if k in (5, 14, 22) else pytest.param(axes, marks=pytest.mark.long)
    for k, axes in enumerate(rotations()) if k])
def test_the_rotation_to_set_is_that_of_the_imu(axes, events):
    found = next(one for one in found_in(turned(axes)(events, ROBOT), ROBOT)
                 if 'imu.rotation to [' in one.action)
    rotation = found.action.partition('imu.rotation to [')[2].partition(']')[0]
    assert np.abs(matrix(*map(float, rotation.split(','))) - axes.T).max() < 0.01
