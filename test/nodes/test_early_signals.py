"""A signal while the modules of a node still load: an end without a traceback."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.processes

SENT = """
import os, signal, sys
sys.argv = [{started!r}]
import smart_tire.nodes
os.kill(os.getpid(), signal.{name})
print('still here')
"""


def run(started, name):
    return subprocess.run([sys.executable, '-c', SENT.format(started=started, name=name)],
                          capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize('started', ['-m', '/opt/lib/smart_tire/imu_driver'])
@pytest.mark.parametrize('name', ['SIGINT', 'SIGTERM'])
def test_a_node_that_still_loads_ends_at_once_and_cleanly(started, name):
    result = run(started, name)
    assert (result.returncode, result.stdout, result.stderr) == (0, '', '')


def test_other_programs_keep_their_own_way_with_signals():
    result = run('/usr/bin/some_program', 'SIGINT')
    assert result.returncode != 0 and 'KeyboardInterrupt' in result.stderr


def test_a_signal_that_was_held_back_ends_a_node_when_it_can():
    block = lambda: signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # noqa: E731
    code = SENT.format(started='-m', name='SIGINT').replace(
        'import smart_tire.nodes\nos.kill(os.getpid(), signal.SIGINT)',
        'os.kill(os.getpid(), signal.SIGINT)\nimport smart_tire.nodes')
    result = subprocess.run([sys.executable, '-c', code], preexec_fn=block,
                            capture_output=True, text=True, timeout=60)
    assert (result.returncode, result.stdout, result.stderr) == (0, '', '')
