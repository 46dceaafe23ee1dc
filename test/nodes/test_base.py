# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Base class of nodes: executor, diagnostics, time, namespaces and uncaught exceptions."""

from __future__ import annotations

from contextlib import ExitStack
import os
import subprocess
import sys
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from smart_tire.host_load import EXPLAINED, HostLoad, MAX_LATENESS, other_problems
from smart_tire.nodes.compat import plain_message
from smart_tire.nodes.diagnostics import InputCounter, Status
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.motor_driver import MotorDriver
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.nodes.wheel_controller import WheelController
from smart_tire.samples import NS_PER_S
from support.graph import Process
from support.virtual_node import virtual

pytestmark = pytest.mark.processes

OLD_DISTRIBUTION = """
import sys

sys.modules['rclpy.experimental'] = None
from smart_tire.nodes import motor_driver

sys.exit(motor_driver.main())
"""


def test_nodes_run_with_the_single_threaded_executor_of_older_distributions(graph, tmp_path):
    with Process(['-c', OLD_DISTRIBUTION], tmp_path / 'log') as node:
        graph.until(lambda: 'motor_driver' in graph.health)
        assert not graph.call('std_srvs/srv/SetBool', 'emergency_stop', data=True).success
        graph.until(lambda: 'emergency stop' in graph.status_message('motor_driver'))
        assert node.end() == 0
        assert 'Traceback' not in node.output


@pytest.mark.parametrize(('node_class', 'least', 'most'), [
    (WheelController, 90, 110), (MotorDriver, 90, 110),  # they look for stalls every 0.1 s
    (TrajectoryController, 10, 10), (SlipEstimatorNode, 10, 10), (FrictionEstimatorNode, 10, 10)])
def test_a_node_without_input_wakes_up_once_a_second_or_to_look_for_stalls(
        node_class, least, most):
    with virtual(node_class) as node:
        node.run(3.0)  # the end of the silence that is awaited after its start
        before = len(node.received['/diagnostics'])
        wake_ups, end_ns = 0, node.steady_ns() + 10 * NS_PER_S
        while node.loop_timers.due_ns <= end_ns:
            node.run((node.loop_timers.due_ns - node.steady_ns()) / NS_PER_S)
            wake_ups += 1
        assert len(node.received['/diagnostics']) - before == 10
        assert least <= wake_ups <= most


def test_locations_in_the_sources_of_rcl_are_removed_from_its_messages():
    error = RuntimeError("failed to initialize rcl: Couldn't parse params file: '--params-file "
                         "x.yaml'. Error: Error opening YAML file, at /project/src/parser.c:271, "
                         'at /project/src/rcl/arguments.c:415')
    assert plain_message(error) == ("Couldn't parse params file: '--params-file x.yaml'. "
                                    'Error: Error opening YAML file')


def test_only_the_1st_2nd_4th_and_8th_rejection_is_logged():
    counter = InputCounter()
    assert [count for count in range(1, 20) if counter.reject()] == [1, 2, 4, 8, 16]


def test_a_status_has_what_is_new_since_the_previous_one():
    counts = {}
    assert [Status(counts=counts).new('bad', count) for count in (3, 3, 7, 2)] == [3, 0, 4, 2]


def test_ages_are_measured_from_the_latest_accepted_input():
    counter = InputCounter()
    assert counter.age(5_000_000_000) == float('inf')
    counter.accept(3_000_000_000)
    counter.reject()
    assert counter.age(5_000_000_000) == 2.0


def test_messages_that_are_lost_or_not_handed_over_in_the_process_are_reported(isolated_ros):
    with virtual(TrajectoryController) as node:
        assert node.profiles['emergency_stop_active'].depth == 10  # a short stop is not missed
        node.mailbox.inboxes['odom'] = SimpleNamespace(
            lost=3, route=SimpleNamespace(publishers={'/a'}))
        node.publishers_of['odom'] = {b'1': 'a'}
        lost = '3 messages lost: this node is too slow'
        health = node.health()
        assert lost in health.message and 'not received' not in health.message
        assert (health.values['messages_lost'], health.values[EXPLAINED]) == ('3', lost)
        node.publishers_of['odom'][b'2'] = 'b'
        text = 'odom: /b not received, expected /a only, in the same process'
        for _ in range(2):
            message = node.health().message
            assert text in message and 'lost' not in message
        assert node.log.lines.count(f'warning: {text}') == 1


def test_simulated_time_without_a_clock_is_in_the_diagnostics(isolated_ros):
    with virtual(SlipEstimatorNode) as node:
        assert '/clock' not in node.health().message
        node.now_ns = lambda: 0  # as rclpy with use_sim_time until /clock is received
        health = node.health()
        assert 'use_sim_time is set, but nothing was received on /clock' in health.message
        assert health.level == DiagnosticStatus.WARN


def test_errors_take_precedence_over_warnings():
    status = Status()
    assert (status.message('x').level, status.message('x').message) == (b'\x00', 'ok')
    status.warn('slow')
    assert status.message('x').level == b'\x01'
    status.error('gone')
    status.values['age'] = 1.25
    message = status.message('x', '/dev/x')
    assert (message.level, message.message) == (b'\x02', 'gone; slow')
    assert [(item.key, item.value) for item in message.values] == [('age', '1.25')]
    assert message.hardware_id == '/dev/x'


def test_a_late_host_is_the_message_without_what_it_explains():
    status = Status(host=HostLoad(0.031, 0.4, 36.0, 2))
    status.warn('dropped', by_host=True)
    status.error('no readings', by_host=True)
    status.warn('port busy')
    message = status.message('x')
    assert (message.level, message.message) == (b'\x02', f'{status.host}; port busy')
    assert not message.values
    late_only = Status(host=HostLoad(0.031, 0.4, 36.0, 2)).message('x')
    assert (late_only.level, late_only.message) == (b'\x01', str(status.host))


def test_what_a_late_host_would_explain_is_marked_for_those_who_know_of_it():
    status = Status(host=HostLoad(0.001, 0.4, 36.0, 2))
    for text, by_host in (('dropped', True), ('port busy', False), ('lost', True)):
        status.warn(text, by_host=by_host)
    message = status.message('x')
    assert (message.level, message.message) == (b'\x01', 'dropped; port busy; lost')
    values = {item.key: item.value for item in message.values}
    assert values == {EXPLAINED: 'dropped; lost'}
    assert other_problems(message.message, values, late=True) == 'port busy'
    assert other_problems(message.message, values, late=False) == message.message


def test_with_use_sim_time_stamps_are_simulated_and_names_follow_the_namespace(graph):
    clock, received = graph.node.create_publisher(Clock, '/clock', 10), []
    graph.node.create_subscription(
        JointState, 'robot/wheel_commands', lambda msg: received.append(msg.header.stamp.sec), 10)

    def tick():
        message = Clock()
        message.clock.sec = 100
        clock.publish(message)

    with graph.start('wheel_controller', namespace='/robot', use_sim_time='true') as node:
        graph.until(lambda: received[-5:] == [100] * 5, tick)  # the timer advances, /clock not
        graph.until(lambda: 'robot/wheel_controller' in graph.health)
        assert node.end() == 0


BUSY = 'while True: pass'
LOWEST_PRIORITY = 19

DEFECTIVE_NODE = """
import sys, threading
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.runner import run
from smart_tire.parameters import WheelControllerParams


class Defective(SmartTireNode):
    def __init__(self):
        super().__init__('defective', WheelControllerParams)

    def start(self):
        threading.Thread(target=lambda: 1 / 0).start()


sys.exit(run(Defective))
"""


def test_an_uncaught_exception_in_a_thread_ends_the_node(graph, tmp_path):
    with Process(['-c', DEFECTIVE_NODE], tmp_path / 'log') as node:
        assert node.ended() == 1
        assert 'ZeroDivisionError' in node.output


@pytest.mark.long  # four busy loops; support of the same in test_host_load
def test_a_node_that_waits_for_a_core_reports_the_host(graph):
    core = {min(os.sched_getaffinity(0))}
    with graph.start('wheel_controller') as node, ExitStack() as loops:
        graph.until(lambda: 'wheel_controller' in graph.health)
        os.sched_setaffinity(node.popen.pid, core)
        os.setpriority(os.PRIO_PROCESS, node.popen.pid, LOWEST_PRIORITY)
        for _ in range(4):
            loop = loops.enter_context(subprocess.Popen([sys.executable, '-c', BUSY]))
            loops.callback(loop.kill)
            os.sched_setaffinity(loop.pid, core)
        graph.until(lambda: 'timers late by' in graph.status_message('wheel_controller'))
        assert 'end other programs' in graph.status_message('wheel_controller')
        assert float(graph.value('wheel_controller', 'host.timer_lateness')) > MAX_LATENESS
