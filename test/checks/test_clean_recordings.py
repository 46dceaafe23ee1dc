# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""No false findings: simulated drives on two grounds, and real recordings."""

from __future__ import annotations

from benchmarks.robots.draws import draw
import pytest
from smart_tire.bags import Bag
from smart_tire.checks import CHECKS, findings, LIVE
from smart_tire.checks.recording import read
from smart_tire.findings import Level
from smart_tire.parameters import build, RobotParams, SimulatorParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.simulation.offline import simulate
from support.checked import clean, problems, recording, texts
from support.real_recordings import real_recording

WARTHOG = RobotParams(wheel_radius=0.30, track_width=1.08, wheelbase=0.8, mass=250.0)
HUSKY = RobotParams(wheel_radius=0.165, track_width=0.555, wheelbase=0.54, mass=50.0)


@pytest.mark.parametrize('seed, base', [
    (1, 'concrete'), pytest.param(2, 'concrete', marks=pytest.mark.long), (3, 'sand')])
def test_a_clean_drive_has_no_warnings(seed, base):
    assert texts(problems(clean(seed, base))) == ''


@pytest.mark.parametrize('seed, base, drive, wheel_rate', [
    pytest.param(2, 'concrete', ((2.0, -60.0, 60.0), (8.0, 0.0, 0.0), (10.0, 60.0, -60.0)), 4.0,
                 id='pivot'),
    pytest.param(1, 'sand', ((1.0, 15.0, 15.0), (10.0, 20.0, 12.0), (20.0, 12.0, 20.0)), 16.0,
                 id='slow', marks=pytest.mark.long),
    pytest.param(1, 'sand', ((0.5, 100.0, 70.0),), 16.0, id='circle', marks=pytest.mark.long)])
def test_a_drive_that_excites_little_proves_nothing(seed, base, drive, wheel_rate):
    robot = RobotParams(film=TreadFilmParams(wheels=()))
    assert texts(problems(clean(seed, base, drive, wheel_rate, robot), robot)) == ''


@pytest.mark.parametrize('seed, drive, seconds', [
    (68, (120.0, 60.0), 6.0), (68, (120.0, 60.0), 8.0), (71, (60.0, 120.0), 5.0)])
def test_the_first_turn_in_one_direction_shows_no_radius(seed, drive, seconds):
    params = build(SimulatorParams, {'seed': seed, 'film.wheels': []})
    found = findings(recording([event for event in simulate(params, [(2.5, *drive)], seconds)
                                if event[1] in ('imu/data', 'wheel_states')], params.robot), LIVE)
    assert not [one for one in found if one.level is Level.ERROR]


def test_a_straight_drive_whose_yaw_rate_follows_the_speed_has_no_errors():
    """A slip that differs by side yields 7 mrad/s, in proportion to the speed."""
    one = draw('sand_straight', 2004)
    assert 'ERROR' not in texts(problems([
        (sample.stamp_ns, '', sample) for sample in one.inputs()], one.robot))


def test_a_clean_drive_confirms_radius_track_and_gravity():
    confirmed = {one.where for one in findings(recording(clean())) if one.level is Level.OK}
    assert {'wheel_radius', 'track_width', 'imu/data', 'wheel_states'} <= confirmed


def test_an_empty_recording_lacks_its_inputs():
    found = texts(problems([]))
    assert found.count('no messages') == 3
    assert 'ERROR imu/data' in found and 'ERROR wheel_states' in found
    assert 'WARNING tire_samples' in found


@pytest.mark.parametrize('check', CHECKS)
@pytest.mark.parametrize('count', [1, 3, 30])
def test_checks_accept_short_recordings(check, count):
    list(check(recording(clean()[:count])))


def errors(name, robot):
    """Return the errors of a real recording."""
    with Bag(real_recording(name)) as bag:
        return [one for one in findings(read(bag, robot)) if one.level is Level.ERROR]


def test_the_default_radius_contradicts_a_robot_with_larger_wheels():
    found, = errors('warthog_asphalt', RobotParams())
    assert found.where == 'wheel_radius' and 'radius of 0.2' in found.found


@pytest.mark.parametrize('name, robot', [('warthog_asphalt', WARTHOG), ('husky_rectangle', HUSKY)])
def test_real_recordings_with_their_geometry_have_no_errors(name, robot):
    assert texts(errors(name, robot)) == ''
