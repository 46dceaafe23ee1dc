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

"""From live samples to the scene of the viewer, with the delay of this program."""

from __future__ import annotations

from statistics import median
import time
from typing import TYPE_CHECKING

from smart_tire.messages import NodeStatus
from smart_tire.samples import Sample

if TYPE_CHECKING:
    from smart_tire.view.scene import Scene

FLUSH_PERIOD = 0.1  # s between two transmissions to the viewer


class LiveFeed:
    """
    Passes samples and statuses to the scene, and measures the delay of the program.

    The delay is the time from the reception of a sample until it has left this process, of the
    oldest sample of each transmission.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._oldest: float | None = None  # s, reception of the oldest sample not yet sent
        self.samples = 0
        self.delays: list[float] = []  # s

    def on_sample(self, topic: str, sample: Sample) -> None:
        """Show a sample that was just received."""
        if self._oldest is None:
            self._oldest = time.monotonic()
        self.samples += 1
        self._scene.add_sample(topic, sample)

    def on_status(self, status: NodeStatus) -> None:
        """Show the status of a node that was just received."""
        self._scene.add_status(time.time_ns(), status)

    def flush(self) -> None:
        """Send what was received."""
        self._scene.flush()
        if self._oldest is not None:
            delay = time.monotonic() - self._oldest
            self._oldest = None
            self.delays.append(delay)
            self._scene.add_delay(time.time_ns(), delay)

    def report(self) -> str:
        """Return the delays as a line of text."""
        if not self.delays:
            return 'no samples received'
        return (f'{self.samples} samples; from reception until sent to the viewer: median '
                f'{median(self.delays):.2f} s, at most {max(self.delays):.2f} s')
