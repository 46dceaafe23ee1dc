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
import termios
from types import SimpleNamespace

import pytest
from smart_tire.cli import _progress
from smart_tire.cli._progress import ERASE_LINE, PERIOD, ProgressLine, Rate
from smart_tire.cli.main import run_verb
from smart_tire.cli.record import RecordStatus
from smart_tire.cli.replay import ReplayStatus
from support.waiting import wait_for


class Clock:
    """Clock [s] that a test sets."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def timer(monkeypatch):
    """Return the settings of the timer of this process, which does not run."""
    settings = []
    monkeypatch.setattr(_progress.signal, 'setitimer',
                        lambda which, *times: settings.append(times) or (0.0, 0.0))
    return settings


def test_silence_is_interrupted_by_lines_on_standard_error(tmp_path, clock, timer):
    path = tmp_path / 'shown'
    with path.open('w') as stream, ProgressLine('think', stream=stream, clock=clock):
        for clock.now in (104.0, 108.4):
            signal.raise_signal(signal.SIGALRM)
    assert path.read_text() == 'think: working, 4 s\nthink: working, 8 s\n'
    assert timer == [(PERIOD, PERIOD), (PERIOD, PERIOD), (0.0, 0.0)]  # begin, end, as it was


def test_the_timer_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(_progress, 'PERIOD', 0.01)
    path = tmp_path / 'shown'
    with path.open('w') as stream, ProgressLine('think', stream=stream):
        wait_for(lambda: path.read_text().count('think: working') >= 2)


def test_output_restarts_the_time_without_output(tmp_path, timer):
    with (tmp_path / 'shown').open('w') as stream, ProgressLine(stream=stream):
        for number in range(3):
            timer.clear()
            print('result', number, end='', flush=True)
            assert set(timer) == {(PERIOD, PERIOD)}
    assert (tmp_path / 'shown').read_text() == ''


LINE = f'{ERASE_LINE}think: working, 0 s\r'


def read(reader, size):
    """Return this number of characters, which a terminal passes on piece by piece."""
    data = b''
    while len(data) < size:
        data += reader.read(size - len(data))
    return data.decode()


def test_on_a_terminal_the_line_is_erased_before_output_and_at_the_end(clock, timer, capsys):
    control, terminal = pty.openpty()
    with os.fdopen(control, 'rb', 0) as reader, os.fdopen(terminal, 'w') as stream:
        with ProgressLine('think', stream=stream, clock=clock):
            signal.raise_signal(signal.SIGALRM)
            print('result', end='', flush=True)
            signal.raise_signal(signal.SIGALRM)
        assert read(reader, 2 * len(f'{LINE}{ERASE_LINE}')) == 2 * f'{LINE}{ERASE_LINE}'
    assert capsys.readouterr().out == 'result'


def test_the_handler_is_removed_after_an_error(timer):
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(KeyError), ProgressLine('think'):
        assert signal.getsignal(signal.SIGALRM) != before
        raise KeyError
    assert signal.getsignal(signal.SIGALRM) == before


@pytest.mark.parametrize('verb', [
    'analyze', 'compare', 'identify', 'measure', 'recover', 'reproduce'])
def test_verbs_that_compute_for_long_have_a_heartbeat(verb, monkeypatch):
    monkeypatch.setattr(import_module(f'smart_tire.cli.{verb}'), 'run',
                        lambda args: signal.getitimer(signal.ITIMER_REAL)[1])
    assert run_verb(Namespace(verb=verb)) == 4
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_the_latest_text_is_shown_now_and_then(tmp_path):
    clock, path = iter(range(100)), tmp_path / 'shown'
    with path.open('w') as stream, ProgressLine(
            timer=False, stream=stream, clock=lambda: next(clock)) as progress:
        for number in range(20):
            progress.show(f'step {number}')
    steps = [int(line.split()[1]) for line in path.read_text().splitlines()]
    assert len(steps) > 2 and min(b - a for a, b in zip(steps, steps[1:])) >= PERIOD - 1


@pytest.mark.parametrize(('columns', 'shown'), [(10, 9), (0, 79)])  # 0: it does not know
def test_the_share_is_shown_within_the_width_of_a_terminal(columns, shown):
    control, terminal = pty.openpty()
    with os.fdopen(control, 'rb', 0) as reader, os.fdopen(terminal, 'w') as stream:
        termios.tcsetwinsize(terminal, (20, columns))
        with ProgressLine('a long name' * 9, timer=False, stream=stream) as progress:
            progress.share(0.5)
        line = f'{ERASE_LINE}{("a long name" * 9)[:shown]}\r{ERASE_LINE}'
        assert read(reader, len(line)) == line


def test_one_progress_within_another_gives_the_timer_back():
    with ProgressLine('outer'):
        with ProgressLine('inner'):
            pass
        assert signal.getitimer(signal.ITIMER_REAL)[1] == PERIOD


def test_a_rate_is_that_since_the_previous_call():
    rate = Rate()
    assert rate.since(10.0, 1.0) is None
    assert rate.since(30.0, 5.0) == 5.0
    assert rate.since(30.0, 6.0) == 0.0
    assert rate.since(40.0, 6.0) is None
    assert rate.since(43.0, 7.0) == 3.0


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
