# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The clock of the drivers: reading it, sleeping, waiting. Tests replace it by a virtual one."""

from __future__ import annotations

import threading
import time


class Clock:
    """Time of this machine; the only source of time of the port threads."""

    def now_ns(self) -> int:
        """Return the steady time [ns]."""
        return time.monotonic_ns()

    def time_ns(self) -> int:
        """Return the time since the epoch [ns]."""
        return time.time_ns()

    def sleep(self, seconds: float) -> None:
        """Return after ``seconds``."""
        time.sleep(seconds)

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Return when ``event`` is set, or after ``seconds``; return whether it is set."""
        return event.wait(seconds)


SYSTEM = Clock()
