# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
ROS 2 nodes: each connects drivers or estimators to topics and contains no algorithm.

On import as the main program of a node, ``--help`` and ``--version`` are answered, and SIGINT and
SIGTERM are set to end the process with status 0 until the node installs its own handlers, since
importing takes a noticeable time.
"""

import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

EXECUTABLES = {path.stem for path in Path(__file__).parent.glob('*.py')}
EXIT_DELAY = 1.0  # s, longer than launch takes to send its second SIGINT on a busy machine
_interrupts: list[int] = []


def _exit(number: int, frame: Any) -> None:
    # Launch without a terminal sends a second SIGINT after that of the process group. If this
    # process had ended before, sending would reap it and launch would report that it died.
    if number == signal.SIGINT and not _interrupts:
        _interrupts.append(number)
        time.sleep(EXIT_DELAY)  # ended by the second signal
    os._exit(0)  # nothing to clean up yet


os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # as in smart_tire.cli.main

if sys.argv[0] == '-m' or Path(sys.argv[0]).name in EXECUTABLES:  # ``python -m``, or a script
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, _exit)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # see smart_tire.launching
    if any(word in ('-h', '--help', '--version') for word in sys.argv[1:]):
        from smart_tire.nodes.command_line import answer, started_module
        _answer = answer(sys.argv, started_module() if sys.argv[0] == '-m' else '')
        if _answer is not None:
            sys.stdout.write(_answer)
            sys.exit(0)
