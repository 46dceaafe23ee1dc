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
from typing import TYPE_CHECKING

from smart_tire.cli._live_feed import FLUSH_PERIOD, LiveFeed
from smart_tire.nodes.observer import Listener
from smart_tire.nodes.runner import NodeRunner
from smart_tire.view.recorder import ViewError

if TYPE_CHECKING:
    from smart_tire.view.scene import Scene
    from smart_tire.view.viewer import Viewer

NODE = 'smart_tire_view'


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
