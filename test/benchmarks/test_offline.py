# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Benchmark of the offline analysis: repeated drives, measured programs."""

from benchmarks.offline import ANALYSIS, dense, DURATION, measured, PLAIN, write_bag
import pytest
from smart_tire.bags import Bag
from smart_tire.errors import SmartTireError
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample

START = 5 * NS_PER_S
END = START + round(DURATION * NS_PER_S)


def event(topic, sample):
    return sample.stamp_ns + 1000, topic, sample


EVENTS = [
    event('wheel_states', WheelSample(START, (0.0,) * 4, (1.0, 2.0, 3.0, 4.0))),
    event('imu/data', ImuSample(START + 1, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))),
    event('wheel_states', WheelSample(END - 1, (0.0,) * 4, (11.0, 22.0, 33.0, 44.0)))]


def test_the_wheels_of_a_repeated_drive_go_on_turning(tmp_path):
    write_bag(tmp_path / 'bag', EVENTS, 3)
    with Bag(tmp_path / 'bag') as bag:
        found = [sample for _, _, sample in bag.samples(['wheel_states'])]
        assert bag.topics['/imu/data'].messages == 3
    assert [one.stamp_ns for one in found] == [
        turn * (END - START) + stamp for turn in range(3) for stamp in (START, END - 1)]
    assert [one.position[3] for one in found] == [4.0, 44.0, 44.0, 84.0, 84.0, 124.0]


@pytest.mark.long
def test_reading_and_analysis_are_measured(tmp_path):
    write_bag(tmp_path / 'bag', EVENTS, 1)
    (tmp_path / 'params.yaml').write_text('{}')
    for program in PLAIN, ANALYSIS:
        cpu, wall, size = measured(program, tmp_path / 'bag', tmp_path / 'params.yaml',
                                   tmp_path / 'out')
        assert cpu > 0.0 and wall > 0.0 and 10.0 < size < 2000.0


@pytest.mark.long
def test_a_program_that_fails_is_reported(tmp_path):
    with pytest.raises(SmartTireError, match='(?s)has failed.*missing'):
        measured(PLAIN, tmp_path / 'missing')


def test_dense_wheel_samples_lie_on_the_lines_between_those_that_exist():
    first, second, third = (event('wheel_states', WheelSample(
        stamp, (speed,) * 4, (0.0, 1.0, 2.0, angle), (0.5,) * 4)) for stamp, speed, angle in (
            (START, 1.0, 3.0), (START + 80, 3.0, 7.0), (START + 90, 3.0, 7.0)))
    imu = event('imu/data', ImuSample(START + 41, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0)))
    assert dense([first, imu, second, third], 1) == [first, imu, second, third]
    found = dense([first, imu, second], 4)
    assert [one[0] - START - 1000 for one in found] == [0, 20, 40, 41, 60, 80]
    assert found[1][2] == WheelSample(
        START + 20, (1.5,) * 4, (0.0, 1.0, 2.0, 4.0), (0.5,) * 4)
    assert [one for one in found if one in (first, imu, second)] == [first, imu, second]
