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
Checks of the latest samples of a running robot, in a process of their own.

In a thread of a node they hold up its messages while libraries are loaded and they run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import os
import pickle
import signal
import sys

from smart_tire.checks import findings, LIVE
from smart_tire.checks.recording import CheckedRecording
from smart_tire.findings import Finding, Level
from smart_tire.host_load import HostLoad
from smart_tire.parameters import RobotParams
from smart_tire.recording import Faults, SampleArrays
from smart_tire.samples import ImuSample, WheelSample


def errors_of(robot: RobotParams, received: Sequence[tuple[int, ImuSample | WheelSample]],
              host: HostLoad, completed: Counter[str]) -> list[Finding]:
    """Return the errors in samples with the times [ns] at which they were received."""
    samples = SampleArrays()
    for receive_ns, sample in received:
        samples.add_sample(sample, receive_ns)
    return [one for one in findings(CheckedRecording(
        robot, samples, Faults(completed=completed), live=True, host=host), LIVE)
        if one.level is Level.ERROR]


def main() -> None:
    """Read the arguments of ``errors_of`` from stdin, write its result and CPU time [s]."""
    os.nice(19)  # after all nodes
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # ends without a word if the node has ended
    try:
        job = pickle.load(sys.stdin.buffer)
    except (EOFError, pickle.UnpicklingError):  # the node has ended
        return
    found = errors_of(*job)
    sys.stdout.buffer.write(pickle.dumps((found, sum(os.times()[:2]))))
