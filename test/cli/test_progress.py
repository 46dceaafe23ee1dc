# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The line that shows what a verb is doing, and its texts of record and replay."""

from __future__ import annotations

from argparse import Namespace
from importlib import import_module
import os
import pty
import shutil
import signal
import subprocess
import sys
import termios
import textwrap
from types import SimpleNamespace

import pytest
from smart_tire.cli._progress import PERIOD, Progress, Rate
from smart_tire.cli.main import run_verb
from smart_tire.cli.record import RecordStatus
from smart_tire.cli.replay import ReplayStatus

pytestmark = pytest.mark.processes

PROGRAM = textwrap.dedent("""
    import signal, sys, time
    from smart_tire.cli import _progress

    _progress.PERIOD = 0.1
    with _progress.Progress('smart_tire think'):
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
        text = reader.read(1000).decode()
    lines = [line.strip('\r') for line in text.split('\r\x1b[K')]
    assert (lines[0], lines[-1]) == ('', '')  # nothing remains
    assert set(lines[1:-1]) == {BEAT}


def test_the_handler_is_removed_after_an_error():
    code = PROGRAM.replace("print('result', word, flush=True)", 'raise KeyError')
    done = subprocess.run([sys.executable, '-c', code, '0'], capture_output=True, text=True,
                          check=False)
    assert done.returncode == 1  # not by SIGALRM
    assert 'KeyError' in done.stderr


@pytest.mark.parametrize('verb', ['analyze', 'identify', 'measure', 'recover', 'reproduce'])
def test_verbs_that_compute_for_long_have_a_heartbeat(verb, monkeypatch):
    monkeypatch.setattr(import_module(f'smart_tire.cli.{verb}'), 'run',
                        lambda args: signal.getitimer(signal.ITIMER_REAL)[1])
    assert run_verb(Namespace(verb=verb)) == 4
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_the_latest_text_is_shown_now_and_then(tmp_path):
    clock, path = iter(range(100)), tmp_path / 'shown'
    with path.open('w') as stream, Progress(
            timer=False, stream=stream, clock=lambda: next(clock)) as progress:
        for number in range(20):
            progress.show(f'step {number}')
    steps = [int(line.split()[1]) for line in path.read_text().splitlines()]
    assert len(steps) > 2 and min(b - a for a, b in zip(steps, steps[1:])) >= PERIOD - 1


def test_the_share_is_shown_within_the_width_of_a_terminal():
    control, terminal = pty.openpty()
    with os.fdopen(control, 'rb', 0) as reader, os.fdopen(terminal, 'w') as stream:
        termios.tcsetwinsize(terminal, (20, 10))
        with Progress('a long name', timer=False, stream=stream) as progress:
            progress.share(0.5)
        assert reader.read(100) == b'\r\x1b[Ka long na\r\r\x1b[K'


def test_one_progress_within_another_gives_the_timer_back():
    with Progress('outer'):
        with Progress('inner'):
            pass
        assert signal.getitimer(signal.ITIMER_REAL)[1] == PERIOD


def test_a_rate_is_that_since_the_previous_call():
    rate = Rate()
    assert rate.since(10.0, 1.0) is None
    assert rate.since(30.0, 5.0) == 5.0
    assert rate.since(30.0, 6.0) == 0.0
    assert rate.since(40.0, 6.0) is None
    assert rate.since(43.0, 7.0) == 3.0


class Clock:
    """Clock [s] that a test sets."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_a_recording_shows_time_messages_rate_size_space_and_losses(tmp_path, clock, monkeypatch):
    monkeypatch.setattr(shutil, 'disk_usage', lambda path: SimpleNamespace(
        free=2e9 if path == tmp_path else 0))
    status = RecordStatus(tmp_path, clock)
    (tmp_path / 'bag_0.mcap').write_bytes(bytes(1200))
    (tmp_path / 'metadata.yaml').write_bytes(bytes(300))
    clock.now += 61.0
    assert status.text({'/odom': 100}, 0) == (
        '0:01:01  100 messages on 1 topic  1.5 kB  2.0 GB free')
    clock.now += 2.0
    assert status.text({'/odom': 300, '/icr': 50}, 7) == (
        '0:01:03  350 messages on 2 topics  125/s  1.5 kB  2.0 GB free  7 lost')


def test_a_replay_shows_position_rate_and_remaining_time(clock):
    status = ReplayStatus(100.0, clock)
    assert status.text(0.0) == '0:00:00 of 0:01:40    0%'
    clock.now += 0.5
    assert status.text(1.0) == '0:00:01 of 0:01:40    1%  2 times the recorded rate  0:00:50 left'
    clock.now += 1.0
    assert status.text(1.0) == '0:00:01 of 0:01:40    1%'  # waits for an estimator
    clock.now += 1.0
    assert status.text(101.0) == (
        '0:01:41 of 0:01:40  100%  100 times the recorded rate  0:00:00 left')
