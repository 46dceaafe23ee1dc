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

"""Requests to stop: signals set a flag, and a closed terminal is no error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from smart_tire.cli._keyboard import SIGNALS, StopRequest


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_a_flag_and_the_handlers_return(number):
    before = [signal.getsignal(one) for one in SIGNALS]
    with StopRequest() as stopped:
        assert not stopped
        os.kill(os.getpid(), number)
        assert stopped
        os.kill(os.getpid(), number)  # repeated: nothing is interrupted
    assert [signal.getsignal(one) for one in SIGNALS] == before


def test_output_after_the_terminal_was_closed_is_discarded():
    code = ('import os, signal; from smart_tire.cli._keyboard import StopRequest\n'
            'with StopRequest() as stopped:\n'
            '    print("before", flush=True); os.kill(os.getpid(), signal.SIGHUP)\n'
            '    print("after", flush=True); assert stopped')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, 'before\n', '')
