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

"""Checks of the host: bounds of each finding."""

from __future__ import annotations

from pathlib import Path

import pytest

from smart_tire.cli._live_checks import (
    disk_finding, disk_findings, lateness_finding, load_finding, timer_lateness)
from smart_tire.findings import Level


class Clock:
    """A clock that its sleeps advance, each by 1 ms more than asked for, the tenth by 30 ms."""

    def __init__(self):
        self.now, self.sleeps = 0.0, 0

    def sleep(self, seconds):
        self.sleeps += 1
        self.now += seconds + (0.030 if self.sleeps == 10 else 0.001)

    def read(self):
        return self.now


def test_lateness_is_measured_per_sleep():
    clock = Clock()
    late = timer_lateness(clock.sleep, clock.read)
    assert len(late) == clock.sleeps == 200
    assert late[0] == pytest.approx(0.001) and late[-1] == pytest.approx(0.030)
    assert late[-2] == pytest.approx(0.001)


@pytest.mark.parametrize('late, level', [
    ([0.001] * 199 + [0.049], Level.OK), ([0.001] * 199 + [0.051], Level.WARNING),
    ([0.009] * 200, Level.OK), ([0.011] * 200, Level.WARNING)])
def test_late_timers_are_a_warning(late, level):
    assert lateness_finding(late).level is level


@pytest.mark.parametrize('load, level', [(1.5, Level.OK), (1.7, Level.WARNING)])
def test_a_busy_host_is_a_warning(load, level):
    assert load_finding(load, 2).level is level


@pytest.mark.parametrize('free, speed, level', [
    (3.7e9, 5.1e6, Level.OK), (3.5e9, 5.1e6, Level.WARNING), (3.7e9, 4.9e6, Level.WARNING)])
def test_space_and_speed_of_the_disk_are_compared_with_a_recording(free, speed, level):
    finding = disk_finding('disk', free, speed, 1e6)
    assert finding.level is level
    assert '1.0 h of recording at 1.00 MB/s' in finding.found


def test_a_writable_folder_is_measured_and_a_missing_one_an_error(tmp_path):
    found, = disk_findings(tmp_path, 1e3)
    assert found.level is Level.OK and not list(tmp_path.iterdir())
    found, = disk_findings(Path('/no/such/folder'), 1e3)
    assert found.level is Level.ERROR
