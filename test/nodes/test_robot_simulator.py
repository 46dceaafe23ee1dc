# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The simulator's node around a simulated robot that does nothing."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest
from smart_tire.errors import LinkError, ParameterError
from smart_tire.nodes import robot_simulator
from smart_tire.nodes.robot_simulator import RobotSimulator
from smart_tire.samples import Friction
from support.virtual_node import virtual

pytestmark = pytest.mark.processes


class Hardware:
    """Ports that are in use until ``free_at`` [s]; ``clock`` advances with each sleep."""

    dropped = {'front_left': 2, 'rear_left': 3}
    bad_requests, lost_bytes, clock_jumps = 4, 5, 6
    free_at = now = 0.0
    closed_at = None

    def __init__(self):
        self.ended = threading.Event()

    def make(self, params, publish, now_ns, namespace):
        self.publish, self.namespace = publish, namespace
        return self

    def run(self, clock, stopping, keeper):
        stopping.wait()
        self.ended.set()

    @property
    def in_use(self):
        return self.now < self.free_at

    def sleep(self, seconds):
        self.now += seconds

    def close(self):
        assert self.ended.is_set()
        self.closed_at = self.now


@pytest.fixture
def hardware(isolated_ros, monkeypatch):
    """Return the hardware of the next simulator."""
    made = Hardware()
    monkeypatch.setattr(robot_simulator, 'SimulatedHardware', made.make)
    monkeypatch.setattr(robot_simulator, 'time', SimpleNamespace(
        time_ns=lambda: 1, monotonic=lambda: made.now, sleep=made.sleep))
    return made


def test_the_losses_of_the_links_and_the_end_of_the_simulation_are_reported(hardware):
    with virtual(RobotSimulator) as node:
        health = node.health()
        assert 'simulation' not in health.message
        assert {name: int(health.values[name]) for name in (
            'batches_dropped', 'front_left.batches_dropped', 'rear_left.batches_dropped',
            'frames_bad', 'bytes_not_taken', 'clock_jumps')} == {
            'batches_dropped': 5, 'front_left.batches_dropped': 2,
            'rear_left.batches_dropped': 3, 'frames_bad': 4, 'bytes_not_taken': 5,
            'clock_jumps': 6}
        hardware.publish(Friction(1, 'rear_left'))
        assert node.latest('ground_truth/tire_friction').wheel == 'rear_left'
        assert node._thread.daemon
        node._stopping.set()
        node._thread.join()
        assert 'the simulation has stopped' in node.health().message
        hardware.free_at = 1e9
    assert hardware.closed_at == 0.0  # nothing to wait for


@pytest.mark.parametrize('free_at, closed_at', [
    (0.0, 0.0), (0.09, 0.1), (1e9, 2.0)])
def test_the_ports_are_removed_once_the_drivers_have_closed_them(hardware, free_at, closed_at):
    with virtual(RobotSimulator):
        hardware.free_at = free_at
    assert hardware.closed_at == pytest.approx(closed_at, abs=0.001 if free_at < 2.0 else 0.021)


def test_ports_that_cannot_be_made_are_a_parameter_error(hardware, monkeypatch):
    def fail(*_):
        raise LinkError('no folder')
    monkeypatch.setattr(robot_simulator, 'SimulatedHardware', fail)
    with pytest.raises(ParameterError, match='ports or truth_log: no folder'), \
            virtual(RobotSimulator):
        pass
