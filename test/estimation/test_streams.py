# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of streams agrees with the topics of the messages."""

import pytest

from smart_tire.estimation.streams import (
    ESTIMATES, FRICTION, HOLDING, INPUTS, sensor_inputs, SLIP)
from smart_tire.messages import TOPICS


@pytest.mark.parametrize('streams', [SLIP, FRICTION])
def test_samples_travel_on_their_topics(streams):
    for topics in (streams.inputs, streams.outputs):
        for kind, name in topics.items():
            assert TOPICS[name].sample is kind


def test_sensor_inputs_are_not_published_by_an_estimator():
    assert INPUTS == ('imu/data', 'wheel_states', 'tire_samples')
    assert sensor_inputs(SLIP) == ('imu/data', 'wheel_states')
    assert not set(INPUTS) & set(ESTIMATES)


def test_each_estimate_has_one_source():
    assert ESTIMATES == ('odom', 'wheel_slip', 'icr', 'tire_friction', 'ground_state')


def test_samples_that_hold_are_published_with_the_rate_of_their_topic():
    for name, period_ns in HOLDING.items():
        assert TOPICS[name].rate == 1e9 / period_ns
