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

"""Live topics in the viewer: ``smart_tire view --live``."""

from __future__ import annotations

from functools import partial
import signal
from statistics import median
import time
from typing import TYPE_CHECKING

from smart_tire.messages import NodeStatus
from smart_tire.nodes.listener import Listener
from smart_tire.nodes.runner import NodeRunner
from smart_tire.samples import Sample
from smart_tire.view.recorder import ViewError

if TYPE_CHECKING:
    from smart_tire.view.scene import Scene
    from smart_tire.view.viewer import Viewer

NODE = 'smart_tire_view'
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
        self._scene.add(topic, sample)

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


def show_live(scene: Scene, viewer: Viewer | None) -> int:
    """Show live topics until SIGINT, SIGTERM, or the end of the viewer; return exit status 0."""
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda which, _: stopped.append(which))
    feed = LiveFeed(scene)
    with NodeRunner(partial(Listener, feed.on_sample, feed.on_status, topics=scene.topics,
                            name=NODE)) as runner:
        try:
            while not stopped and (viewer is None or viewer.running):
                runner.spin(FLUSH_PERIOD)
                feed.flush()
            scene.finish()
        except ViewError:
            pass  # the user has closed the viewer
    print(feed.report())
    return 0
