# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire drive`` with the simulator and all nodes."""

from __future__ import annotations

import json
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time

import pytest
from smart_tire.bags import Bag
from support.waiting import PATIENCE, wait_for

pytestmark = [pytest.mark.processes, pytest.mark.long]

UP = b'\x1b[A'
REPETITION = 0.033  # s


class Terminal:
    """A program on a terminal of its own."""

    def __init__(self, *words):
        self.process, self._end = pty.fork()
        if not self.process:
            os.environ.update(TERM='xterm', COLUMNS='120', LINES='30')
            os.execv(sys.executable, [sys.executable, '-m', 'smart_tire.cli.main', *words])
        self.output = b''

    def read(self, seconds, until=None):
        """Collect output for ``seconds``, or until it contains a text; return whether it does."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not (until and until in self.output):
            if select.select([self._end], [], [], 0.05)[0]:
                try:
                    self.output += os.read(self._end, 1 << 16)
                except OSError:  # the program has ended
                    break
        return bool(until) and until in self.output

    def hold(self, key, seconds):
        """Press a key and hold it, as a terminal reports it; return the time of its release."""
        os.write(self._end, key)
        self.read(0.5)
        for _ in range(round(seconds / REPETITION)):
            os.write(self._end, key)
            self.read(REPETITION)
        return time.time()

    def send_key(self, key):
        os.write(self._end, key)

    def echoes(self):
        """Return whether typed text is shown, as in a shell."""
        return bool(termios.tcgetattr(self._end)[3] & termios.ECHO)

    def ended(self):
        self.read(PATIENCE, b'summary.json are in')
        self.read(PATIENCE)
        return os.waitstatus_to_exitcode(os.waitpid(self.process, 0)[1])

    def close(self):
        os.close(self._end)


def commands(bag):
    """Return (time [s], command) of each ``cmd_vel``."""
    with Bag(bag) as reader:
        return [(receive_ns * 1e-9, sample)
                for receive_ns, _, sample in reader.samples(['cmd_vel'])]


def test_the_simulated_robot_drives_a_lane_change(tmp_path):
    out = tmp_path / 'out'
    words = [sys.executable, '-m', 'smart_tire.cli.main', 'drive', '--path', 'lane_change',
             '--out', str(out)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=5.0 * PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['tracking']['state'] == 'arrived'
    assert summary['tracking']['in_truth']['max_m'] < 0.05
    assert summary['tracking']['in_truth']['end_m'] < 0.1
    assert 'lane_change: arrived' in done.stdout
    assert (out / 'path.png').stat().st_size > 10_000


def test_keys_drive_and_the_terminal_is_restored(tmp_path):
    terminal = Terminal('drive', '--keyboard', '--out', str(tmp_path))
    assert terminal.read(PATIENCE, b'arrows or WASD'), terminal.output
    assert not terminal.echoes()
    released = terminal.hold(UP, 2.0)
    terminal.output = b''
    assert terminal.read(PATIENCE, b'command +0.00'), terminal.output
    terminal.send_key(b'q')
    assert terminal.ended() == 0
    assert terminal.echoes()
    terminal.close()
    sent = commands(tmp_path / 'bag')
    assert max(command.v_x for _, command in sent) == pytest.approx(0.3)
    assert sent[-1][1].v_x == 0.0
    driven = [time for time, command in sent if command.v_x > 0.0]
    assert released < driven[-1] < sent[-1][0]
    summary = json.loads((tmp_path / 'summary.json').read_text())
    assert summary['estimates']['odom']['distance_m'] > 0.3


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_path_is_canceled_by_a_signal(tmp_path, number):
    terminal = Terminal('drive', '--path', 'square', '--out', str(tmp_path))
    assert terminal.read(PATIENCE, b'm left'), terminal.output
    recorder = tmp_path / 'logs' / 'recorder.log'
    wait_for(lambda: '/cmd_vel' in recorder.read_text(), lambda: terminal.read(0.2))
    terminal.read(1.0)
    os.kill(terminal.process, number)
    assert os.waitstatus_to_exitcode(os.waitpid(terminal.process, 0)[1]) == 130
    terminal.close()
    log = (tmp_path / 'logs' / 'trajectory_controller.log').read_text()
    assert 'canceled by cancel_path' in log
    assert commands(tmp_path / 'bag')[-1][1].v_x == 0.0
