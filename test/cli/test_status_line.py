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

"""Status of record and replay as text."""

from __future__ import annotations

import shutil
from types import SimpleNamespace

import pytest

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


def test_a_bag_without_duration_is_complete():
    assert ReplayStatus(0.0).text(0.0) == '0:00:00 of 0:00:00  100%'
