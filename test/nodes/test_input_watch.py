# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Log of inputs: what is logged when an input is missing, begins, stops and returns."""

from __future__ import annotations

import pytest
from smart_tire.nodes.diagnostics import InputLog
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.nodes.wheel_controller import WheelController
from support.virtual_node import Log, virtual

pytestmark = pytest.mark.processes

START_NS = 7_000_000_000
TENTH_NS = 100_000_000


class Inputs:
    """Counts, clock [ns] and logged lines of a test."""

    def __init__(self):
        self.now_ns, self.excuse, self.counts = START_NS, False, {}
        self._logger = Log(lambda: self.now_ns)
        self.log = InputLog(self._logger, lambda: self.now_ns)

    def add(self, name, *, required=True):
        self.counts[name] = 0
        self.log.watch(name, lambda: self.counts[name], required=required,
                       excused=lambda: self.excuse)

    def run(self, seconds, **rates):
        """Let time pass in tenths of a second; ``rates`` are messages per tenth."""
        for _ in range(round(10 * seconds)):
            self.now_ns += TENTH_NS
            for name, rate in rates.items():
                self.counts[name] += rate
            self.log.check()
        lines, self._logger.lines = self._logger.lines, []
        return lines


@pytest.fixture
def inputs():
    return Inputs()


def test_missing_inputs_are_logged_together_at_growing_intervals(inputs):
    inputs.add('imu')
    inputs.add('wheels')
    inputs.add('film', required=False)
    assert inputs.run(1.9) == []
    assert inputs.run(0.1) == ['waiting for imu, wheels (2 s)']
    assert inputs.run(5.9) == []
    assert inputs.run(0.1) == ['waiting for imu, wheels (8 s)']
    assert inputs.run(24.0) == ['waiting for imu, wheels (32 s)']


def test_an_input_that_begins_is_no_longer_waited_for(inputs):
    inputs.add('imu')
    inputs.add('wheels')
    inputs.run(1.0)
    assert inputs.run(1.0, imu=10) == ['waiting for wheels (2 s)']


def test_the_first_messages_are_logged_once_with_their_rate(inputs):
    inputs.add('imu')
    assert inputs.run(1.0, imu=10) == []
    assert inputs.run(0.1, imu=10) == ['receiving imu at 100 Hz']
    assert inputs.run(100.0, imu=10) == []


def test_a_single_message_has_no_rate(inputs):
    inputs.add('ground', required=False)
    inputs.counts['ground'] = 1
    assert inputs.run(1.0) == []
    assert inputs.run(0.1) == ['receiving ground']


@pytest.mark.parametrize(('pause', 'lines'), [
    (2.0, []), (2.1, ['warning: no imu for 2.0 s']), (60.0, ['warning: no imu for 2.0 s'])])
def test_silence_of_a_required_input_is_a_warning_once(inputs, pause, lines):
    inputs.add('imu')
    inputs.run(2.0, imu=1)
    assert inputs.run(pause) == lines


def test_its_return_is_logged_with_the_length_of_the_gap(inputs):
    inputs.add('imu')
    inputs.run(2.0, imu=1)
    inputs.run(3.1)
    assert inputs.run(0.1, imu=1) == ['imu again after 3.2 s']
    assert inputs.run(10.0, imu=1) == []
    assert inputs.run(2.1) == ['warning: no imu for 2.0 s']


def test_silence_of_an_optional_input_is_not_logged(inputs):
    inputs.add('cmd_vel', required=False)
    assert inputs.run(3.0) == []
    assert inputs.run(1.1, cmd_vel=1) == ['receiving cmd_vel at 10 Hz']
    assert inputs.run(60.0) == []
    assert inputs.run(1.0, cmd_vel=1) == []


def test_silence_with_a_known_reason_is_not_logged_but_its_end_is(inputs):
    inputs.add('frames')
    inputs.excuse = True
    assert inputs.run(60.0) == []
    inputs.excuse = False
    assert inputs.run(1.9) == []
    assert inputs.run(0.1) == ['waiting for frames (2 s)']
    inputs.run(2.0, frames=1)
    inputs.excuse = True
    assert inputs.run(5.0) == []
    inputs.excuse = False
    assert inputs.run(0.1, frames=1) == ['frames again after 5.1 s']


@pytest.mark.parametrize('kind, required, others', [
    (TrajectoryController, {'odom'}, {'wheel_states', 'wheel_slip', 'ground_state'}),
    (WheelController, {'wheel_states'}, {'cmd_vel'}),
    (SlipEstimatorNode, {'imu/data', 'wheel_states'}, set()),
    (FrictionEstimatorNode, {'imu/data', 'wheel_states', 'tire_samples'}, set())])
def test_the_watched_inputs_of_a_node(isolated_ros, kind, required, others):
    with virtual(kind) as node:
        watched = {watch.name: watch.required for watch, _, _ in node.input_log._inputs}
        assert watched == dict.fromkeys(required, True) | dict.fromkeys(others, False)
