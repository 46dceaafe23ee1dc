# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Order of the calls and exit status of processes with nodes, without ROS and signals."""

from __future__ import annotations

from contextlib import nullcontext
import os
from pathlib import Path
import signal
import sys
import threading
from types import SimpleNamespace

import pytest
from smart_tire import nodes
from smart_tire.errors import ParameterError
from smart_tire.nodes import (
    composed, friction_estimator, imu_driver, motor_driver, overhead_camera_simulator,
    overhead_localizer, robot_simulator, runner, slip_estimator, tire_receiver,
    trajectory_controller, wheel_controller)
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import PROFILES, TRANSPORTS
from smart_tire.nodes.timers import Timers
from support.waiting import PATIENCE

pytestmark = pytest.mark.processes


class Node:
    """A node that notes what is called."""

    def __init__(self, name, calls, priority=None):
        self.name, self.calls, self.warnings = name, calls, []
        self.params = SimpleNamespace() if priority is None else SimpleNamespace(
            realtime_priority=priority)
        self.mailbox = SimpleNamespace(handle=lambda: calls.append(f'mail {name}'))
        self.loop_timers = Timers()
        for call in ('start', 'stop', 'destroy_node'):
            setattr(self, call, lambda call=call: calls.append(f'{call} {name}'))

    def get_name(self):
        return self.name

    def get_logger(self):
        return SimpleNamespace(warning=self.warnings.append)


class Executor:
    """An executor whose node is handled by ``spin``."""

    def __init__(self, calls, spin):
        self.calls, self.spin = calls, spin

    def add_node(self, node):
        self.name = node.name

    def remove_node(self, node):
        self.calls.append(f'remove {self.name} {node.name}')

    def shutdown(self):
        self.calls.append(f'shutdown {self.name}')

    def create_task(self, task):
        task()

    def spin_once(self, timeout_sec):
        self.calls.append(f'spin {self.name}')
        self.spin(self.name)


@pytest.fixture
def spun(monkeypatch):
    """Return a function that spins nodes; it returns the calls of each, and the exit status."""
    def spin_all(nodes, spin, ending, calls):
        monkeypatch.setattr(runner, 'new_executor', lambda: Executor(calls, spin))
        return runner._spin_all([lambda node=node: node for node in nodes], ending)
    return spin_all


def test_subscribers_are_stopped_first_and_all_nodes_are_released(spun):
    calls, ending, both = [], runner.Ending(), threading.Barrier(2)

    def spin(name):
        if not ending.statuses:
            both.wait(PATIENCE)  # in two threads at the same time
        if name == 'a':
            ending.end(runner.EXIT_OK)
    nodes = [Node(name, calls) for name in 'ab']
    assert spun(nodes, spin, ending, calls) == 0
    assert calls[:2] == ['start a', 'start b']
    assert {'spin a', 'mail a', 'spin b', 'mail b'} <= set(calls)
    assert calls[-8:] == ['stop b', 'stop a', 'remove a a', 'shutdown a', 'destroy_node a',
                          'remove b b', 'shutdown b', 'destroy_node b']


@pytest.mark.parametrize('next_timer, timeout', [(1.0, 1.0), (0.03, 0.03), (-1.0, 0.001)])
def test_the_loop_calls_the_timers_and_waits_for_the_next(next_timer, timeout):
    calls, ending = [], runner.Ending()
    node = Node('a', calls)
    node.loop_timers = SimpleNamespace(handle=lambda: calls.append('timers') or next_timer)

    def spin_once(timeout_sec):
        calls.append(timeout_sec)
        ending.end(runner.EXIT_OK)
    runner._spin(node, SimpleNamespace(spin_once=spin_once), ending)
    assert calls == ['timers', timeout, 'mail a']
    calls.clear()
    times = iter([0, 0, 60_000_000, 200_000_000])  # ns
    node.steady_ns = lambda: next(times)
    spun = SimpleNamespace(node=node, _executor=SimpleNamespace(
        spin_once=lambda timeout_sec: calls.append(timeout_sec)))
    runner.NodeRunner.spin(spun, 0.08)
    assert calls == ['timers', min(timeout, 0.08), 'timers', min(timeout, 0.02)]


@pytest.mark.parametrize('failing', ['a', 'b'])
def test_an_exception_at_the_start_ends_all_nodes(spun, failing):
    calls, ending = [], runner.Ending()
    nodes = [Node(name, calls) for name in 'ab']

    def fail():
        raise KeyError(failing)
    nodes['ab'.index(failing)].start = fail
    with pytest.raises(KeyError):
        spun(nodes, lambda name: None, ending, calls)
    assert ending.statuses == [1] and calls[-8:-6] == ['stop b', 'stop a']


def test_an_exception_in_the_first_thread_ends_the_others(spun):
    calls, ending = [], runner.Ending()

    def spin(name):
        if name == 'a':
            raise KeyError(name)
    with pytest.raises(KeyError):
        spun([Node(name, calls) for name in 'ab'], spin, ending, calls)
    assert ending.statuses == [1] and calls[-1] == 'destroy_node b'


def test_a_signal_ends_the_wait_of_an_executor():
    ending, woken, calls = runner.Ending(), threading.Event(), []
    ending.executors.append(SimpleNamespace(create_task=lambda task: woken.set()))
    before = signal.signal(signal.SIGUSR1, lambda *_: calls.append('handler'))
    try:
        with runner._waking_at_signals(ending):
            os.kill(os.getpid(), signal.SIGUSR1)
            assert woken.wait(PATIENCE)
            assert calls == ['handler']
    finally:
        signal.signal(signal.SIGUSR1, before)


@pytest.fixture
def fatal(monkeypatch):
    """Return the lines that a refused start logs."""
    lines = []
    monkeypatch.setattr(runner, 'get_logger', lambda name: SimpleNamespace(fatal=lines.append))
    return lines


@pytest.mark.parametrize('error', [ParameterError('rate is 0'), runner.RCLError('rate is 0')])
def test_a_node_that_cannot_be_made_is_refused(fatal, error):
    def make():
        raise error
    assert runner._spin_all([make], []) == 2
    assert fatal == ['rate is 0']


@pytest.fixture
def process(monkeypatch):
    """Return handlers of signals, calls of ROS and the arguments of a process with nodes."""
    made = SimpleNamespace(handlers={}, calls=[], words=['node'], before=[])
    monkeypatch.setattr(signal, 'signal', made.handlers.__setitem__)
    monkeypatch.setattr(threading, 'excepthook', made.before.append)
    monkeypatch.setattr(runner.sys, 'argv', made.words)
    monkeypatch.setattr(runner.rclpy, 'init', lambda **options: made.calls.append(
        options['signal_handler_options']))
    monkeypatch.setattr(runner.rclpy, 'try_shutdown', lambda: made.calls.append('shutdown'))
    return made


@pytest.mark.parametrize('end, status', [
    (lambda one: one.handlers[signal.SIGINT](2, None), 0),
    (lambda one: one.handlers[signal.SIGTERM](15, None), 0),
    (lambda one: threading.excepthook('trouble'), 1)])
def test_the_first_signal_or_exception_gives_the_exit_status(process, monkeypatch, end, status):
    def spin_all(classes, ending, images):
        assert classes == ('a', 'b') and not ending.statuses and not images
        end(process)
        process.handlers[signal.SIGINT](2, None)
        return ending.statuses[0]
    monkeypatch.setattr(runner, '_spin_all', spin_all)
    assert runner.run('a', 'b') == status
    assert process.calls == [runner.SignalHandlerOptions.NO, 'shutdown']
    assert process.before == ['trouble'] * status  # printed by the hook before
    assert process.handlers == dict.fromkeys((signal.SIGINT, signal.SIGTERM), signal.SIG_IGN)


def test_foreign_arguments_are_refused_unless_they_are_own(process, fatal, monkeypatch):
    process.words.append('--fast')
    monkeypatch.setattr(runner, '_spin_all', lambda classes, ending, images: 0)
    assert runner.run() == 2 and not process.calls
    assert fatal == ['unknown arguments: --fast (ROS arguments come after --ros-args)']
    assert runner.run(own_arguments=True) == 0


def test_a_parameter_file_is_read_before_rcl_reads_it(process, fatal, tmp_path):
    process.words += ['--ros-args', '--params-file', str(tmp_path / 'missing.yaml')]
    assert runner.run() == 2 and not process.calls
    assert len(fatal) == 1 and 'missing.yaml' in fatal[0]


def test_arguments_that_rcl_refuses_are_named(process, fatal, monkeypatch):
    def refuse(**_):
        raise RuntimeError('Failed to parse: -p, at x.c:3')
    monkeypatch.setattr(runner.rclpy, 'init', refuse)
    assert runner.run() == 2
    assert fatal[0].startswith('ROS arguments: Failed to parse')


@pytest.mark.parametrize('priorities, asked', [
    ((0, 20, 5, None), [20]), ((None, 7), [7]), ((None, 0), []), ((None,), [])])
def test_the_highest_priority_of_the_nodes_is_requested(monkeypatch, priorities, asked):
    nodes, requested = [Node('a', [], priority) for priority in priorities], []
    monkeypatch.setattr(runner, 'request_priority',
                        lambda priority: requested.append(priority) or 'not permitted')
    runner._request_priority(nodes)
    assert requested == asked
    assert sum((node.warnings for node in nodes), []) == ['not permitted'] * len(asked)


@pytest.mark.parametrize('module', [
    friction_estimator, imu_driver, motor_driver, overhead_camera_simulator, overhead_localizer,
    robot_simulator, slip_estimator, tire_receiver, trajectory_controller, wheel_controller])
def test_main_runs_the_node_of_its_module_and_returns_the_exit_status(monkeypatch, module):
    given = []
    monkeypatch.setattr(module, 'run', lambda *classes, images=False: given.extend(classes) or 3)
    assert module.main() == 3 and [one.__module__ for one in given] == [module.__name__]


@pytest.mark.parametrize('words, names, live', [
    ([], ['tire_receiver', 'imu_driver', 'friction_estimator', 'slip_estimator',
          'trajectory_controller'], True),
    (['slip_estimator', 'imu_driver'], ['imu_driver', 'slip_estimator'], True),
    (['slip_estimator'], ['slip_estimator'], False)])
def test_the_named_nodes_are_composed_publishers_first(monkeypatch, words, names, live):
    given, interval = [], []
    monkeypatch.setattr(composed, 'run', lambda *classes, own_arguments: (
        given.extend(classes) or 3 * own_arguments))
    monkeypatch.setattr(sys, 'argv', ['composed', *words])
    monkeypatch.setattr(sys, 'setswitchinterval', interval.append)
    monkeypatch.setattr(SmartTireNode, 'exchange', None)
    assert composed.main() == 3 and interval == [0.0005]
    assert given == [composed.NODES[name] for name in names]
    assert SmartTireNode.exchange.live is live


@pytest.mark.parametrize('words, begin', [
    (['pytest', '--help'], None), (['imu_driver'], ''), (['/lib/imu_driver', '--versions'], ''),
    (['/lib/imu_driver', '--version'], 'imu_driver ('), (['-m', '-h'], 'slip_estimator ('),
    (['-m', 'x', '--help'], 'slip_estimator (')])
def test_a_node_handles_signals_and_answers_before_its_imports(monkeypatch, capsys, words, begin):
    handlers, masks = {}, []
    monkeypatch.setattr(signal, 'signal', handlers.__setitem__)
    monkeypatch.setattr(signal, 'pthread_sigmask', lambda *given: masks.append(given))
    monkeypatch.setattr(sys, 'argv', words)
    monkeypatch.setattr(sys, 'orig_argv', ['', '-m', 'smart_tire.nodes.slip_estimator', ''])
    file = Path(nodes.__file__)
    with pytest.raises(SystemExit, match='^0$') if begin else nullcontext():
        exec(compile(file.read_text(), file, 'exec'), {'__file__': str(file), '__name__': 'begun'})
    text = capsys.readouterr().out
    assert text.startswith(begin or '') and bool(text) == bool(begin)
    assert [*handlers] == ([] if begin is None else [signal.SIGINT, signal.SIGTERM])
    assert masks == [(signal.SIG_UNBLOCK, {signal.SIGINT})] * (begin is not None)


def test_before_its_imports_a_node_awaits_a_second_sigint_for_a_second(monkeypatch):
    slept, statuses = [], []
    monkeypatch.setattr(nodes.time, 'sleep', slept.append)
    monkeypatch.setattr(nodes.os, '_exit', statuses.append)
    monkeypatch.setattr(nodes, '_interrupts', [])
    for number, times in ((signal.SIGTERM, 0), (signal.SIGINT, 1), (signal.SIGINT, 1)):
        nodes._exit(number, None)
        assert slept == [1.0] * times
    assert statuses == [0] * 3


@pytest.mark.parametrize('choice', [{}, {TRANSPORTS: 'LARGE_DATA'}, {PROFILES[0]: 'own.xml'},
                                    {PROFILES[1]: 'own.xml'}])
@pytest.mark.parametrize('images', [False, True])
def test_shared_memory_is_not_used_unless_chosen_or_for_images(monkeypatch, choice, images):
    for name in (TRANSPORTS, *PROFILES):
        monkeypatch.delenv(name, raising=False)
    for name, value in choice.items():
        monkeypatch.setenv(name, value)
    found = []

    def new_node():
        found.append(os.environ.get(TRANSPORTS))
        raise ParameterError('not needed')

    assert runner._spin_all([new_node], [], images) == runner.EXIT_REFUSED
    assert found == ['UDPv4' if not choice and not images else choice.get(TRANSPORTS)]
    assert os.environ.get(TRANSPORTS) == choice.get(TRANSPORTS)
