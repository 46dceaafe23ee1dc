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

"""Checks of the host: punctuality of timers, load, space and speed of the disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import os
from pathlib import Path
import shutil
import tempfile
import time

from smart_tire.findings import Finding, Level

PERIOD, DURATION = 0.005, 1.0     # s, of the sleeps that are measured
MAX_TYPICAL_LATENESS = 0.010      # s, 99 % of them; reorder_window of the estimators is 0.03
MAX_LATENESS = 0.050              # s; a poll of the motor boards at 16 Hz is then skipped
MAX_LOAD = 0.8                    # processes per core that want to run, over one minute
TEST_SIZE = 8 << 20               # bytes written to measure the disk
NOMINAL_RATE = 0.3e6              # bytes/s of a recording with two instrumented wheels
SPEED_RESERVE = 5.0               # speed of the disk over the rate of a recording
MIN_RECORDING_TIME = 3600.0       # s that must fit on the disk


def host_findings(folder: Path, rate: float = NOMINAL_RATE) -> Iterator[Finding]:
    """Yield the findings on this host; recordings of ``rate`` [bytes/s] go to ``folder``."""
    yield lateness_finding(timer_lateness())
    yield load_finding(os.getloadavg()[0], os.cpu_count() or 1)
    yield from disk_findings(folder, rate)


def timer_lateness(sleep: Callable[[float], None] = time.sleep,
                   clock: Callable[[], float] = time.monotonic) -> list[float]:
    """Return how late [s] each of the sleeps ended, sorted."""
    late = []
    for _ in range(round(DURATION / PERIOD)):
        due = clock() + PERIOD
        sleep(PERIOD)
        late.append(clock() - due)
    return sorted(late)


def lateness_finding(late: list[float]) -> Finding:
    """Return the finding on sorted latenesses [s]."""
    typical, worst = late[int(0.99 * (len(late) - 1))], late[-1]
    found = (f'timers are late by {1e3 * typical:.1f} ms (99 %), {1e3 * worst:.1f} ms at worst')
    if typical > MAX_TYPICAL_LATENESS or worst > MAX_LATENESS:
        return Finding(Level.WARNING, 'host', found, f'{1e3 * MAX_TYPICAL_LATENESS:g} and '
                       f'{1e3 * MAX_LATENESS:g} ms', 'end other programs, or use a faster host')
    return Finding(Level.OK, 'host', found)


def load_finding(load: float, cores: int) -> Finding:
    """Return the finding on the load average of one minute."""
    found = f'load {load:.2f} on {cores} cores'
    if load > MAX_LOAD * cores:
        return Finding(Level.WARNING, 'host', found, f'at most {MAX_LOAD * cores:.2g}',
                       'end other programs')
    return Finding(Level.OK, 'host', found)


def disk_findings(folder: Path, rate: float) -> Iterator[Finding]:
    """Yield free space and speed of the disk of ``folder``, against ``rate`` [bytes/s]."""
    try:
        free, speed = shutil.disk_usage(folder).free, write_speed(folder)
    except OSError as error:
        yield Finding(Level.ERROR, f'disk of {folder}', f'cannot be written ({error.strerror})',
                      'a writable folder', 'choose another --out')
        return
    yield disk_finding(f'disk of {folder}', free, speed, rate)


def disk_finding(where: str, free: float, speed: float, rate: float) -> Finding:
    """Return the finding on ``free`` bytes and ``speed`` [bytes/s]."""
    hours = free / rate / 3600.0
    found = (f'{free / 1e9:.1f} GB free, {hours:.1f} h of recording at {rate / 1e6:.2f} MB/s; '
             f'writes {speed / 1e6:.0f} MB/s')
    if free < MIN_RECORDING_TIME * rate:
        return Finding(Level.WARNING, where, found, 'at least 1 h', 'delete old recordings')
    if speed < SPEED_RESERVE * rate:
        return Finding(Level.WARNING, where, found, f'at least {SPEED_RESERVE * rate / 1e6:.1f} '
                       'MB/s', 'record to a faster disk')
    return Finding(Level.OK, where, found)


def write_speed(folder: Path) -> float:
    """Return the speed [bytes/s] at which a file reaches the disk."""
    block = os.urandom(1 << 20)
    with tempfile.TemporaryFile(dir=folder) as file:
        start = time.monotonic()
        for _ in range(TEST_SIZE // len(block)):
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
        return TEST_SIZE / max(time.monotonic() - start, 1e-6)
