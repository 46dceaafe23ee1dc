# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The demo on a host that is late: simulated time stands, and no result is another one."""

from __future__ import annotations

import json
import os
from pathlib import Path
import signal
import subprocess
import sys

import numpy as np
import pytest
from smart_tire.bags import Bag
from smart_tire.drivers.simulated_time import SimulatedTime
from support.waiting import wait_for

pytestmark = [pytest.mark.processes, pytest.mark.long]

MAX_AGE = 0.2   # s of simulated time; on an idle host 0.06
STOPPED = 'slip_estimator', 'imu_driver', 'wheel_controller', 'robot_simulator'


def process_of(out, name):
    """Return the id of the process that writes the log of a node below ``out``."""
    log = (out / 'logs' / f'{name}.log').resolve()
    for path in Path('/proc').glob('[0-9]*/fd/1'):
        try:
            if path.resolve() == log:
                return int(path.parts[2])
        except OSError:
            pass  # ended, or another user's process
    raise AssertionError(f'no process writes {log}')


def stop_until_time_stands(out, name):
    """Stop a process until simulated time stands, for longer than any time-out of the robot."""
    shared = SimulatedTime(out / 'ports' / 'clock')
    latest = [(shared.now_ns(), shared.real_ns())]

    def stands():
        if shared.now_ns() != latest[0][0]:
            latest[0] = shared.now_ns(), shared.real_ns()
        return shared.real_ns() - latest[0][1] > 1_500_000_000

    node = process_of(out, name)
    os.kill(node, signal.SIGSTOP)
    try:
        wait_for(stands)
    finally:
        os.kill(node, signal.SIGCONT)


def test_the_demo_does_not_stop_for_a_node_that_is_late(tmp_path):
    out = tmp_path / 'out'
    words = [sys.executable, '-m', 'smart_tire.cli.main', 'demo', '--out', str(out)]
    with subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as demo:
        lines = []
        for line in demo.stdout:
            lines.append(line)
            if line.startswith('following') and 'figure-eight' in lines[-2]:
                break
        for name in STOPPED:
            stop_until_time_stands(out, name)
        lines += demo.stdout
    text = ''.join(lines)
    assert demo.returncode == 0, text
    assert 'starved' not in text
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['simulated'] and 'x real time' in summary['simulated'][0]
    assert 65.0 < summary['duration_s'] < 100.0  # simulated; with the evaluation two minutes
    for drive in summary['tracking'].values():
        assert drive['state'] == 'arrived'
        assert drive['in_odom']['completed'] > 0.98
    with Bag(out / 'bag') as bag:
        ages = [receive_ns - sample.stamp_ns for receive_ns, _, sample in bag.samples(('odom',))]
    assert np.percentile(ages, 99) * 1e-9 < MAX_AGE
