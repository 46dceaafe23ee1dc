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

from benchmarks.offline import ANALYSIS, DURATION, measured, PLAIN, simulated, write_bag
import pytest
from smart_tire.bags import Bag
from smart_tire.errors import SmartTireError
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample

START = 5 * NS_PER_S
END = START + round(DURATION * NS_PER_S)
LAST = 62_500_000  # ns from the last reading to the end


def event(topic, sample):
    return sample.stamp_ns + 1000, topic, sample


EVENTS = [
    event('wheel_states', WheelSample(START, (0.0,) * 4, (1.0, 2.0, 3.0, 4.0))),
    event('imu/data', ImuSample(START + 1, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))),
    event('wheel_states', WheelSample(END - LAST, (0.0,) * 4, (11.0, 22.0, 33.0, 44.0)))]


def test_the_wheels_of_a_repeated_drive_go_on_turning(tmp_path):
    write_bag(tmp_path / 'bag', EVENTS, 3)
    with Bag(tmp_path / 'bag') as bag:
        found = [sample for _, _, sample in bag.samples(['wheel_states'])]
        assert bag.topics['/imu/data'].messages == 3
    assert [one.stamp_ns for one in found] == [
        turn * (END - START) + stamp for turn in range(3) for stamp in (START, END - LAST)]
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


@pytest.mark.long
def test_wheels_and_imu_have_the_rates_of_the_table():
    for rate, imu_rate in (16, 100), (200, 200):
        found = simulated(1, rate)
        stamps = [sample.stamp_ns for _, _, sample in found if isinstance(sample, WheelSample)]
        assert len(stamps) == pytest.approx(DURATION * rate, rel=0.01)
        readings = sum(isinstance(sample, ImuSample) for _, _, sample in found)
        assert readings == pytest.approx(DURATION * imu_rate, rel=0.01)
