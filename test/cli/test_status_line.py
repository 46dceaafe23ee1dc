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

"""Status lines of record and replay: texts, and when they are shown."""

from __future__ import annotations

import io
import shutil
from types import SimpleNamespace

import pytest
from rich.console import Console

from smart_tire.cli._status_line import duration_text, LINE_PERIOD, Rate, size_text, StatusLine
from smart_tire.cli.record import RecordStatus
from smart_tire.cli.replay import ReplayStatus


class Clock:
    """Clock [s] that a test sets."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_without_a_terminal_a_line_is_printed_now_and_then(clock):
    output = io.StringIO()
    with StatusLine(Console(file=output, width=20), clock) as line:
        for second in range(26):
            clock.now = 100.0 + second
            line.show(f'after [b]{second} seconds of work[/b]')
    assert output.getvalue().splitlines() == [
        'after [b]10 seconds of work[/b]', 'after [b]20 seconds of work[/b]']
    assert LINE_PERIOD == 10.0


def test_on_a_terminal_the_line_is_replaced_and_finally_erased(clock):
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=20, _environ={'TERM': 'xterm'})
    with StatusLine(console, clock) as line:
        line.show('first')
        line.show('second [b], and too long for the terminal')
    text = output.getvalue()
    assert text.index('first\r') < text.index('second [b], and too…\r')
    assert text.count('\n') == 1  # of the end, which moves up and erases the line
    assert text.endswith('\x1b[1A\x1b[2K')


@pytest.mark.parametrize(('seconds', 'text'), [
    (-1.0, '0:00'), (0.9, '0:00'), (59.99, '0:59'), (60.0, '1:00'), (3599.0, '59:59'),
    (3600.0, '1:00:00'), (36061.0, '10:01:01')])
def test_durations_are_in_minutes_and_seconds(seconds, text):
    assert duration_text(seconds) == text


@pytest.mark.parametrize(('size', 'text'), [
    (0, '0 B'), (999, '999 B'), (1000, '1.0 kB'), (99_900, '99.9 kB'), (99_960, '100 kB'),
    (999_400, '999 kB'), (999_600, '1.0 MB'), (2.5e9, '2.5 GB'), (3e12, '3.0 TB'),
    (5e15, '5000 TB')])
def test_sizes_have_decimal_units(size, text):
    assert size_text(size) == text


def test_a_rate_is_that_since_the_previous_call():
    rate = Rate()
    assert rate.update(10.0, 1.0) is None
    assert rate.update(30.0, 5.0) == 5.0
    assert rate.update(30.0, 6.0) == 0.0
    assert rate.update(40.0, 6.0) is None
    assert rate.update(43.0, 7.0) == 3.0


def test_a_recording_shows_time_messages_rate_size_space_and_losses(tmp_path, clock, monkeypatch):
    monkeypatch.setattr(shutil, 'disk_usage', lambda path: SimpleNamespace(
        free=2e9 if path == tmp_path else 0))
    status = RecordStatus(tmp_path, clock)
    (tmp_path / 'bag_0.mcap').write_bytes(bytes(1200))
    (tmp_path / 'metadata.yaml').write_bytes(bytes(300))
    clock.now += 61.0
    assert status.text({'/odom': 100}, 0) == '1:01  100 messages on 1 topic  1.5 kB  2.0 GB free'
    clock.now += 2.0
    assert status.text({'/odom': 300, '/icr': 50}, 7) == (
        '1:03  350 messages on 2 topics  125/s  1.5 kB  2.0 GB free  7 lost')


def test_a_replay_shows_position_rate_and_remaining_time(clock):
    status = ReplayStatus(100.0, clock)
    assert status.text(0.0) == '0:00 of 1:40    0%'
    clock.now += 0.5
    assert status.text(1.0) == '0:01 of 1:40    1%  2 times the recorded rate  0:50 left'
    clock.now += 1.0
    assert status.text(1.0) == '0:01 of 1:40    1%'  # waits for an estimator
    clock.now += 1.0
    assert status.text(101.0) == '1:41 of 1:40  100%  100 times the recorded rate  0:00 left'


def test_a_bag_without_duration_is_complete():
    assert ReplayStatus(0.0).text(0.0) == '0:00 of 0:00  100%'
