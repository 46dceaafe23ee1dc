# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The process stack: logs, failures, CPU time and shutdown."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

from smart_tire.cli import _stack
from smart_tire.cli._stack import isolated_environment, RobotError, Stack
from support.waiting import wait_for

pytestmark = pytest.mark.processes

SLEEPER = 'import signal, sys, time\nprint("ready", flush=True)\n'
POLITE = SLEEPER + 'signal.signal(signal.SIGINT, lambda *_: sys.exit(0))\ntime.sleep(60)\n'


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return a function that writes an importable module."""
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))

    def make(name, text):
        (tmp_path / f'{name}.py').write_text(text)
        return name
    return make


def test_leaving_the_context_interrupts_all_processes(tmp_path, module):
    with Stack(tmp_path / 'logs', isolated_environment()) as stack:
        stack.start('one', module('one', POLITE))
        stack.start('two', module('two', POLITE))
        wait_for(lambda: 'ready' in stack.log('one') and 'ready' in stack.log('two'))
        assert stack.died() == {}
        assert stack.stop('one') == {'one': 0}
    assert stack.died() == {'one': 0, 'two': 0}


def test_a_process_that_dies_is_reported_with_its_last_output(tmp_path, module):
    with Stack(tmp_path / 'logs', isolated_environment()) as stack:
        stack.start('bad', module('bad', 'raise SystemExit("no such port")'))
        wait_for(stack.died)
        assert stack.died() == {'bad': 1}
        assert stack.tail('bad') == 'no such port'


def test_children_end_if_the_parent_is_killed(tmp_path, module):
    module('polite', POLITE)
    parent = module('parent', (
        'import pathlib, sys, time\n'
        'from smart_tire.cli._stack import Stack, isolated_environment\n'
        f'stack = Stack(pathlib.Path({str(tmp_path / "logs")!r}), isolated_environment())\n'
        'stack.start("child", "polite")\n'
        'print(stack.processes["child"].pid, flush=True)\n'
        'time.sleep(60)\n'))
    root = Path(__file__).resolve().parents[2]
    process = subprocess.Popen(
        [sys.executable, '-m', parent], stdout=subprocess.PIPE, text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(tmp_path), str(root)])})
    child = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()

    def gone():
        try:
            state = Path(f'/proc/{child}/stat').read_text().rsplit(')', 1)[1].split()[0]
        except FileNotFoundError:
            return True
        return state in 'ZX'  # it may remain a zombie
    wait_for(gone)


def test_dds_is_restricted_to_this_machine_and_the_domain_of_the_user(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')  # of the user, for a robot
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    environment = isolated_environment()
    assert environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert environment['ROS_DOMAIN_ID'] == '42'


@pytest.mark.parametrize('given', [None, ''])
def test_without_one_the_domain_is_one_that_no_process_here_uses(given, monkeypatch):
    monkeypatch.setattr(_stack, 'DOMAINS', range(7, 10))
    monkeypatch.delenv('ROS_DOMAIN_ID')
    if given is not None:
        monkeypatch.setenv('ROS_DOMAIN_ID', given)
    taken = set[int]()

    class Socket(contextlib.AbstractContextManager):

        def __init__(self, family, kind):
            assert kind == _stack.socket.SOCK_DGRAM

        def __exit__(self, *_):
            return None

        def bind(self, address):
            domain, rest = divmod(address[1] - 7400, 250)  # RTPS 9.6.1.1
            assert rest == 10  # of the first participant
            if domain in taken:
                raise OSError
    monkeypatch.setattr(_stack.socket, 'socket', Socket)
    for free in ({7, 8, 9}, {8}):
        taken = {7, 8, 9} - free
        assert {int(isolated_environment()['ROS_DOMAIN_ID']) for _ in range(50)} == free
    taken = {7, 8, 9}
    with pytest.raises(RobotError, match='all of the 3 ROS domains are in use'):
        isolated_environment()
