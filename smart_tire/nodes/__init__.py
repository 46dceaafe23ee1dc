"""
ROS 2 nodes: each wires links, codecs and estimators to topics and computes nothing itself.

Where Python was started for a node, a signal ends it at once and cleanly until the node has set
its own handlers: its imports take longer than the patience of some who start nodes.
"""

import os
from pathlib import Path
import signal
import sys
from typing import Any

EXECUTABLES = {path.stem for path in Path(__file__).parent.glob('*.py')}


def _leave(number: int, frame: Any) -> None:
    os._exit(0)  # there is nothing to clean up yet


if sys.argv[0] == '-m' or Path(sys.argv[0]).name in EXECUTABLES:  # ``python -m``, or a script
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, _leave)
