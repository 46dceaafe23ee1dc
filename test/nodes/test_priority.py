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

import os
from pathlib import Path
import subprocess
import sys

import pytest
from smart_tire.nodes import priority
from smart_tire.nodes.priority import request_priority

pytestmark = pytest.mark.processes

PRIORITY = 7


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


@pytest.mark.parametrize(('error', 'text'), [
    (PermissionError(1, 'Operation not permitted'), 'limits.d'), (None, ''),
    (OSError(22, 'Invalid argument'), 'realtime_priority 7: Invalid argument')])
def test_a_refusal_is_explained(monkeypatch, error, text):
    asked = []

    def schedule(task, policy, parameters):
        asked.append((task, policy, parameters.sched_priority))
        if error is not None:
            raise error

    monkeypatch.setattr(priority.os, 'sched_setscheduler', schedule)
    assert text in request_priority(PRIORITY)
    assert bool(request_priority(PRIORITY)) == bool(text)
    assert asked[0][1:] == (os.SCHED_FIFO, PRIORITY)
