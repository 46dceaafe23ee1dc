# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Signals while the modules of a node are imported: an end without traceback."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from support.waiting import PATIENCE

pytestmark = pytest.mark.processes

SENT = """
import os, signal, sys
sys.argv = [{started!r}]
import smart_tire.nodes
os.kill(os.getpid(), signal.{name})
print('still running')
"""


def run(started, name):
    return subprocess.run([sys.executable, '-c', SENT.format(started=started, name=name)],
                          capture_output=True, text=True, timeout=PATIENCE)


@pytest.mark.parametrize('started', ['-m', '/opt/lib/smart_tire/imu_driver'])
@pytest.mark.parametrize('name', ['SIGINT', 'SIGTERM'])
def test_a_signal_during_import_ends_a_node_with_status_0(started, name):
    result = run(started, name)
    assert (result.returncode, result.stdout, result.stderr) == (0, '', '')


def test_importing_the_package_elsewhere_leaves_signal_handlers_unchanged():
    result = run('/usr/bin/some_program', 'SIGINT')
    assert result.returncode != 0 and 'KeyboardInterrupt' in result.stderr


def test_a_blocked_signal_ends_a_node_when_it_is_unblocked():
    block = lambda: signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # noqa: E731
    code = SENT.format(started='-m', name='SIGINT').replace(
        'import smart_tire.nodes\nos.kill(os.getpid(), signal.SIGINT)',
        'os.kill(os.getpid(), signal.SIGINT)\nimport smart_tire.nodes')
    result = subprocess.run([sys.executable, '-c', code], preexec_fn=block,
                            capture_output=True, text=True, timeout=PATIENCE)
    assert (result.returncode, result.stdout, result.stderr) == (0, '', '')
