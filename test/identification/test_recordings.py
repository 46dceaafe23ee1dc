# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Calibration from real recordings: observable and unobservable parameters."""

from __future__ import annotations

import math

import pytest
from smart_tire.calibration import geometry, turning
from smart_tire.calibration.geometry import LATENCY, RADIUS, TRACK
from smart_tire.identification.robot import ANY_REFERENCE, NO_REFERENCE, read_recording, TimeRange
from smart_tire.parameters import build, RobotParams
from support.real_recordings import real_recording

WARTHOG = build(RobotParams, {'wheel_radius': 0.3, 'track_width': 1.08, 'wheelbase': 1.05,
                              'imu.position': [0.0, 0.0, 0.0]})
HUSKY = build(RobotParams, {'wheel_radius': 0.1651, 'track_width': 0.555, 'wheelbase': 0.540,
                            'imu.position': [0.0, 0.0, 0.0]})
FIRST_DRIVE = 254.0  # s; the Warthog stands still for the first 134 s


def identify_geometry(path, robot, since=0.0, until=math.inf, reference=NO_REFERENCE):
    return geometry.identify_geometry(
        read_recording(path, robot, TimeRange(since, until), reference), robot)


def identify_icr(path, robot, until=math.inf, reference=NO_REFERENCE):
    return turning.identify_icr(
        read_recording(path, robot, TimeRange(until=until), reference), robot)


@pytest.mark.parametrize('until', [FIRST_DRIVE, 1e6])
def test_the_warthog_shows_latency_radius_and_track(until):
    """Known: a rolling radius of 0.285 m and an effective track of about 1.9 m."""
    found = identify_geometry(real_recording('warthog_asphalt'), WARTHOG, until=until,
                              reference=ANY_REFERENCE)
    latency, radius, track = (found.get(name) for name in (LATENCY, RADIUS, TRACK))
    # 0.17 s as instantaneous speeds; about 0.06 s less as means over 0.1 to 0.15 s
    assert 0.05 < latency.value < 0.13 and latency.sigma < 0.01
    assert radius.value == pytest.approx(0.285, abs=3.0 * radius.sigma)
    assert radius.sigma < 0.01 * radius.value
    assert track.value == pytest.approx(1.9, rel=0.08)


def test_the_mean_wheel_speed_of_the_husky_gives_a_radius_but_no_track():
    found = identify_geometry(real_recording('husky_rectangle'), HUSKY, reference=ANY_REFERENCE)
    assert LATENCY in found.refused and TRACK in found.refused
    assert found.get(RADIUS).value == pytest.approx(0.1651, rel=0.04)


def test_the_icr_of_both_robots_is_within_the_robot():
    for name, robot in (('warthog_asphalt', WARTHOG), ('husky_rectangle', HUSKY)):
        fit = identify_icr(real_recording(name), robot, reference=ANY_REFERENCE)
        assert abs(fit.icr.value) < 0.5 * robot.wheelbase
        assert 'reference' in fit.source
