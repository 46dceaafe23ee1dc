# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Transport faults: only the given topics change, and events stay sorted."""

from benchmarks.faults import delayed, interrupted, reordered, stalled
import pytest
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample


@pytest.fixture
def events():
    """Return 10 s of an IMU at 100 Hz and wheel states at 10 Hz."""
    imu = [('imu/data', ImuSample(n * NS_PER_S // 100, (0.0,) * 3, (0.0,) * 3))
           for n in range(1000)]
    wheels = [('wheel_states', WheelSample(n * NS_PER_S // 10, (0.0,) * 4)) for n in range(100)]
    return sorted(((sample.stamp_ns, topic, sample) for topic, sample in imu + wheels),
                  key=lambda event: event[0])


def of(events, topic):
    """Return the events of ``topic``."""
    return [event for event in events if event[1] == topic]


def test_a_delayed_topic_keeps_its_timestamps(events):
    late = delayed(events, 'wheel_states', 0.2)
    assert [event[0] for event in late] == sorted(event[0] for event in late)
    assert of(late, 'imu/data') == of(events, 'imu/data')
    assert all(received == sample.stamp_ns + NS_PER_S // 5
               for received, _, sample in of(late, 'wheel_states'))


def test_an_interrupted_topic_has_no_messages_in_its_spans(events):
    left = interrupted(events, 'imu/data', ((2.0, 4.0), (9.0, 9.5)))
    assert of(left, 'wheel_states') == of(events, 'wheel_states')
    times = [received / NS_PER_S for received, _, _ in of(left, 'imu/data')]
    assert len(times) == 1000 - 200 - 50
    assert not any(2.0 <= time < 4.0 or 9.0 <= time < 9.5 for time in times)


def test_reordering_duplicates_and_delays_messages_without_losses(events):
    mixed, again = (reordered(events, ('imu/data',), duplicate_share=0.1, late_share=0.2,
                              max_delay=0.025, seed=1) for _ in range(2))
    assert of(mixed, 'wheel_states') == of(events, 'wheel_states')
    assert {sample for _, _, sample in mixed} == {sample for _, _, sample in events}
    assert 1050 < len(of(mixed, 'imu/data')) < 1150
    assert all(0 <= received - sample.stamp_ns <= 25_000_000 for received, _, sample in mixed)
    stamps = [sample.stamp_ns for _, _, sample in of(mixed, 'imu/data')]
    assert stamps != sorted(stamps)
    assert mixed == again


def test_a_stalled_recorder_records_one_topic_after_the_other(events):
    mixed = stalled(events, ((2.0, 2.5),))
    received = [event[0] for event in mixed]
    assert received == sorted(received)
    burst = [event for event in mixed if event[0] == 5 * NS_PER_S // 2][:55]
    assert [topic for _, topic, _ in burst] == ['imu/data'] * 50 + ['wheel_states'] * 5
    assert [sample.stamp_ns for _, _, sample in burst[:50]] == [
        2 * NS_PER_S + n * 10_000_000 for n in range(50)]
    others = [event for event in mixed if event not in burst]
    assert others == [event for event in events if not 2 * NS_PER_S <= event[0] < 2.5 * NS_PER_S]
