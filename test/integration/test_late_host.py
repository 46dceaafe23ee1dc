# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The demo on a host that is late: the robot stops, and the demo resumes the path."""

from __future__ import annotations

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

pytestmark = [pytest.mark.processes, pytest.mark.long]

PAUSE = 1.5  # s, above the time-out of odom in the demo


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


def test_the_demo_resumes_the_path_after_odom_was_late(tmp_path):
    out = tmp_path / 'out'
    words = [sys.executable, '-m', 'smart_tire.cli.main', 'demo', '--out', str(out)]
    with subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as demo:
        lines = []
        for line in demo.stdout:
            lines.append(line)
            if line.startswith('following') and 'figure-eight' in lines[-2]:
                break
        estimator = process_of(out, 'slip_estimator')
        os.kill(estimator, signal.SIGSTOP)
        time.sleep(PAUSE)
        os.kill(estimator, signal.SIGCONT)
        lines += demo.stdout
    text = ''.join(lines)
    assert demo.returncode == 0, text
    assert 'path resumed 1 x after a stop for it' in text
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['late_host']['times'] >= 1
    assert summary['late_host']['longest_s'] > 1.0
    assert summary['late_host']['resumed'] == 1
    eight = summary['tracking']['figure-eight']
    assert eight['state'] == 'arrived' and eight['resumed'] == 1
    assert eight['in_odom']['completed'] > 0.98
    assert eight['in_odom']['end_m'] < 0.1
