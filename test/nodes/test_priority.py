# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Real-time priority: all threads of a node get it, or one line says what is missing."""

from __future__ import annotations

from contextlib import ExitStack
import os
from pathlib import Path
import subprocess
import sys

import pytest
from smart_tire.nodes import runner
from smart_tire.nodes.runner import request_priority

pytestmark = pytest.mark.processes

PRIORITY = 7
LOWEST_PRIORITY = 19  # of processes without real-time priority
BUSY = 'while True: pass'


def is_permitted():
    """Return whether this user may start processes with real-time priority."""
    ask = f'import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({PRIORITY}))'
    return not subprocess.run([sys.executable, '-c', ask], stderr=subprocess.DEVNULL).returncode


def threads(node):
    return [int(path.name) for path in Path(f'/proc/{node.popen.pid}/task').iterdir()]


def test_all_threads_of_a_node_have_the_priority_or_a_warning_says_why_not(graph):
    with graph.start('wheel_controller', realtime_priority=PRIORITY) as node:
        graph.until(lambda: 'wheel_controller' in graph.health)
        if is_permitted():
            found = {(os.sched_getscheduler(one), os.sched_getparam(one).sched_priority)
                     for one in threads(node)}
            assert found == {(os.SCHED_FIFO, PRIORITY)}
            assert 'realtime_priority' not in node.output
        else:
            graph.until(lambda: 'realtime_priority 7 is not permitted' in node.output)
        assert node.end() == 0


WITHOUT_PERMISSION = """
import ctypes, os, resource, sys
PR_CAPBSET_DROP, CAP_SYS_NICE = 24, 23
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
if not os.geteuid():
    assert not ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_SYS_NICE, 0, 0, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


def test_without_permission_the_kernel_refuses_and_one_line_says_what_is_missing():
    ask = f'from smart_tire.nodes.runner import request_priority as r; print(r({PRIORITY}))'
    result = subprocess.run([sys.executable, '-c', WITHOUT_PERMISSION, '-c', ask],
                            stdout=subprocess.PIPE, text=True, check=True)
    assert result.stdout == (
        'realtime_priority 7 is not permitted: add "USER - rtprio 7" to '
        '/etc/security/limits.d/realtime.conf and log in again\n')


@pytest.mark.long  # four busy loops
def test_a_node_with_priority_waits_less_for_a_core_that_others_use(graph):
    if not is_permitted():
        pytest.skip('needs permission for SCHED_FIFO')
    core, names = {min(os.sched_getaffinity(0))}, ('wheel_controller', 'slip_estimator')
    with graph.start(names[0], realtime_priority=PRIORITY) as urgent, \
            graph.start(names[1]) as other, ExitStack() as loops:
        graph.until(lambda: set(names) <= set(graph.health))
        for node in (urgent, other):
            for task in threads(node):
                os.sched_setaffinity(task, core)
            os.setpriority(os.PRIO_PROCESS, node.popen.pid, LOWEST_PRIORITY)
        for _ in range(4):
            loop = loops.enter_context(subprocess.Popen([sys.executable, '-c', BUSY]))
            loops.callback(loop.kill)
            os.sched_setaffinity(loop.pid, core)
        graph.until(lambda: 'timers late by' in graph.status_message(names[1]))
        late = [float(graph.value(name, 'host.timer_lateness')) for name in names]
        assert late[0] < 0.5 * late[1]


@pytest.mark.parametrize(('error', 'text'), [
    (PermissionError(1, 'Operation not permitted'), 'limits.d'), (None, ''),
    (OSError(22, 'Invalid argument'), 'realtime_priority 7: Invalid argument')])
def test_a_refusal_is_explained(monkeypatch, error, text):
    asked = []

    def schedule(task, policy, parameters):
        asked.append((task, policy, parameters.sched_priority))
        if error is not None:
            raise error

    monkeypatch.setattr(runner.os, 'sched_setscheduler', schedule)
    assert text in request_priority(PRIORITY)
    assert bool(request_priority(PRIORITY)) == bool(text)
    assert asked[0][1:] == (os.SCHED_FIFO, PRIORITY)
