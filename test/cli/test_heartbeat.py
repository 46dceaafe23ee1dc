# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Heartbeat of verbs that compute without output."""

from __future__ import annotations

from argparse import Namespace
import os
import pty
import signal
import subprocess
import sys
import textwrap

import pytest

from smart_tire.cli.main import run_verb

PROGRAM = textwrap.dedent("""
    import signal, sys, time
    from smart_tire.cli import _heartbeat

    _heartbeat.PERIOD = 0.1
    with _heartbeat.heartbeat('smart_tire think'):
        for word in sys.argv[1:]:
            time.sleep(float(word))
            print('result', word, flush=True)
    time.sleep(0.25)
    assert signal.getsignal(signal.SIGALRM) == signal.SIG_DFL
    """)
BEAT = 'smart_tire think: working, 0 s'


def run(*words, stderr=subprocess.PIPE):
    """Run the program with pauses before its results [s]."""
    return subprocess.run([sys.executable, '-c', PROGRAM, *words], stdout=subprocess.PIPE,
                          stderr=stderr, text=True, check=True)


def test_silence_is_interrupted_by_lines_on_standard_error():
    done = run('0.35', '0')
    assert done.stdout == 'result 0.35\nresult 0\n'
    lines = done.stderr.splitlines()
    assert set(lines) == {BEAT}
    assert 2 <= len(lines) <= 4  # at 0.1, 0.2 and 0.3 s


def test_frequent_output_needs_no_heartbeat():
    assert run(*['0.01'] * 30).stderr == ''


def test_on_a_terminal_the_line_is_erased_before_output_and_at_the_end():
    control, terminal = pty.openpty()
    with os.fdopen(control, 'rb', 0) as reader:
        run('0.15', stderr=terminal)
        os.close(terminal)
        lines = reader.read(1000).decode().split('\r\x1b[K')
    assert (lines[0], lines[-1]) == ('', '')  # nothing remains
    assert set(lines[1:-1]) == {BEAT}


def test_the_handler_is_removed_after_an_error():
    code = PROGRAM.replace("print('result', word, flush=True)", 'raise KeyError')
    done = subprocess.run([sys.executable, '-c', code, '0'], capture_output=True, text=True,
                          check=False)
    assert done.returncode == 1  # not by SIGALRM
    assert 'KeyError' in done.stderr


@pytest.mark.parametrize('verb', ['analyze', 'identify', 'measure', 'recover', 'reproduce'])
def test_verbs_that_compute_for_long_have_a_heartbeat(verb):
    assert run_verb(Namespace(verb=verb, run=lambda _: signal.getitimer(
        signal.ITIMER_REAL)[1])) == 4
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
