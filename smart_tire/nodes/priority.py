# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Real-time priority of a node, where the host permits it."""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path

TASKS = Path('/proc/self/task')


def request_priority(priority: int) -> str:
    """
    Give all threads of this process the real-time ``priority``, 1 to 99; return '' or the reason.

    Threads with the policy SCHED_FIFO run before all programs without it.
    """
    try:
        for task in TASKS.iterdir():
            with suppress(ProcessLookupError):  # it has ended
                os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return (f'realtime_priority {priority} is not permitted: add "USER - rtprio {priority}" '
                'to /etc/security/limits.d/realtime.conf and log in again')
    except OSError as error:
        return f'realtime_priority {priority}: {error.strerror}'
    return ''
