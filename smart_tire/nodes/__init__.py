"""
ROS 2 nodes: each wires links, codecs and estimators to topics and computes nothing itself.

Where Python was started for a node, a signal ends it soon and cleanly until the node has set
its own handlers: its imports take longer than the patience of some who start nodes.
"""

import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

EXECUTABLES = {path.stem for path in Path(__file__).parent.glob('*.py')}
EXIT_DELAY = 1.0  # s, for a launch on a busy machine
_interrupted: list[int] = []


def _leave(number: int, frame: Any) -> None:
    # A launch without a terminal sends the SIGINT that its process group got once more. If this
    # process ended before that, the sending would reap it, and launch report that it died.
    if number == signal.SIGINT and not _interrupted:
        _interrupted.append(number)
        time.sleep(EXIT_DELAY)  # the second one ends it
    os._exit(0)  # there is nothing to clean up yet


if sys.argv[0] == '-m' or Path(sys.argv[0]).name in EXECUTABLES:  # ``python -m``, or a script
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, _leave)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # see smart_tire.launching
