# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire view``: a recording, or live topics, in the rerun viewer."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from importlib import import_module
import os
from pathlib import Path
import signal
from statistics import median
import sys
import time
from typing import TYPE_CHECKING
import webbrowser

from smart_tire.cli._bags import (
    ESTIMATED, lacks_inputs, NOTHING_ESTIMATED, open_bag, print_checks, REQUIRED)
from smart_tire.cli._outputs import refuse_existing
from smart_tire.cli._progress import ProgressLine
from smart_tire.cli._stack import ANNOUNCED, end_with_parent
from smart_tire.drivers.clock import SYSTEM

if TYPE_CHECKING:
    from smart_tire.analysis.pipeline import EstimatorParams
    from smart_tire.bags import TopicNames
    from smart_tire.messages import NodeStatus
    from smart_tire.samples import Sample
    from smart_tire.view.scene import Scene
    from smart_tire.view.viewer import Viewer

    Show = Callable[[Scene, Viewer | None], int]

USAGE = 2            # exit status
LIVE_NAME = 'live'
NODE = 'smart_tire_view'  # of the live viewer
FLUSH_PERIOD = 0.1   # s between two transmissions to the viewer
CHECK_PERIOD = 0.2   # s, in which a closed viewer is noticed


def run(args: argparse.Namespace) -> int:
    """Show the bag or the live topics; return the exit status."""
    if args.live == (args.bag is not None) or args.live and args.estimate:
        print('smart_tire view: expected either BAG or --live; --estimate is for a BAG',
              file=sys.stderr)
        return USAGE
    if args.no_fit:
        print('smart_tire view: --no-fit has no effect: nothing is fitted', file=sys.stderr)
    if args.save is not None:
        refuse_existing([args.save], force=args.force, inputs=[*args.params])
    from smart_tire.analysis.overhead import overhead_params
    from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams
    from smart_tire.messages import TOPICS
    from smart_tire.parameters import load_node
    from smart_tire.view.bag import find_bags, image_topic
    if args.live:
        # Importing rclpy may restart Python, so it must come before the viewer is started.
        import_module('smart_tire.nodes.observer')
        tags = load_node(args.params, 'overhead_localizer').overhead
        return _with_viewer(args, LIVE_NAME, EstimatorParams.load(args.params), tags.tag_family,
                            _show_live)
    bag, estimates = find_bags(args.bag)
    status = ESTIMATED
    with open_bag(bag, args, required=(), estimates=estimates) as (opened, source):
        camera, found = bool(image_topic(opened)), opened.match(TOPICS)
        if set(REQUIRED) <= found.keys():
            status = print_checks(opened, source) if args.checks else ESTIMATED
        elif not set(ESTIMATES) & found.keys() and lacks_inputs(opened) and not (camera or found):
            return NOTHING_ESTIMATED
        family = overhead_params(opened, args.params).overhead.tag_family if camera else None
    return _with_viewer(
        args, bag.resolve().name, source.params, family,
        partial(_show_bag, args, bag, estimates, source.params, opened.names)) or status


def has_display(environment: Mapping[str, str]) -> bool:
    """Return whether programs can open windows."""
    return bool(environment.get('DISPLAY') or environment.get('WAYLAND_DISPLAY'))


def _with_viewer(args: argparse.Namespace, name: str, params: EstimatorParams,
                 tag_family: str | None, show: Show) -> int:
    """
    Start the viewer, call ``show(scene, viewer)`` and stop a viewer for browsers.

    With a ``tag_family`` there is a page of the images of the overhead camera.
    """
    from smart_tire.view.layout import ViewLayout
    from smart_tire.view.scene import Scene
    from smart_tire.view.viewer import open_stream, Viewer
    display = has_display(os.environ)
    web = args.web or args.save is None and not display
    with ExitStack() as stack:
        viewer = None
        if args.save is None or args.web:
            viewer = Viewer(web=web, wait=time.sleep, prepare=end_with_parent if web else None)
            if web:
                stack.enter_context(viewer)
            print(f'{ANNOUNCED}{viewer.address.page} (Ctrl-C ends it)' if web
                  else f'{ANNOUNCED}a window of its own', flush=True)
            if web and display:
                webbrowser.open(viewer.address.page)
        layout = ViewLayout(params.robot.film.wheels, live=args.live,
                            camera=tag_family is not None)
        stream = open_stream(name, layout.blueprint(), file=args.save,
                             address=viewer.address.stream if viewer else None)
        status = show(Scene(stream, params.robot, *filter(None, [tag_family])), viewer)
        stream.disconnect()
        if args.save is not None:
            print(f'written to {args.save}')
        return status


def _show_bag(args: argparse.Namespace, bag: Path, estimates: Path | None,
              params: EstimatorParams, names: TopicNames, scene: Scene,
              viewer: Viewer | None) -> int:
    """Show a bag; wait while a viewer for browsers is served."""
    from smart_tire.view.bag import show
    with ProgressLine(bag.name) as progress:
        show(bag, estimates, scene, params, estimate=args.estimate,
             describe=partial(print, flush=True), progress=progress.share, names=names)
    if viewer is not None and viewer.address.web is not None:
        try:
            while viewer.running:
                time.sleep(CHECK_PERIOD)
        except KeyboardInterrupt:
            print()
    return 0


class LiveFeed:
    """
    Passes samples and statuses to the scene, and measures the delay of the program.

    The delay is the time from the reception of a sample until it has left this process, of the
    oldest sample of each transmission.
    """

    def __init__(self, scene: Scene, clock: Callable[[], float] = time.monotonic) -> None:
        self._scene, self._clock = scene, clock  # clock in s
        self._oldest: float | None = None  # s, reception of the oldest sample not yet sent
        self.samples = 0
        self.delays: list[float] = []  # s

    def on_sample(self, topic: str, sample: Sample) -> None:
        """Show a sample that was just received."""
        if self._oldest is None:
            self._oldest = self._clock()
        self.samples += 1
        self._scene.add_sample(topic, sample)

    def on_status(self, status: NodeStatus) -> None:
        """Show the status of a node that was just received."""
        self._scene.add_status(SYSTEM.time_ns(), status)

    def on_image(self, kind: str, data: bytes) -> None:
        """Show an image that was just received."""
        self._scene.add_image(SYSTEM.time_ns(), kind, data)

    def flush(self) -> None:
        """Send what was received."""
        self._scene.flush()
        if self._oldest is not None:
            delay = self._clock() - self._oldest
            self._oldest = None
            self.delays.append(delay)
            self._scene.add_delay(SYSTEM.time_ns(), delay)

    def report(self) -> str:
        """Return the delays as a line of text."""
        if not self.delays:
            return 'no samples received'
        return (f'{self.samples} samples; from reception until sent to the viewer: median '
                f'{median(self.delays):.2f} s, at most {max(self.delays):.2f} s')


def _show_live(scene: Scene, viewer: Viewer | None) -> int:
    """Show live topics until SIGINT, SIGTERM, or the end of the viewer; return exit status 0."""
    from smart_tire.nodes.observer import Listener
    from smart_tire.nodes.runner import NodeRunner
    from smart_tire.view.writer import ViewError
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda which, _: stopped.append(which))
    feed = LiveFeed(scene)
    with NodeRunner(partial(Listener, feed.on_sample, feed.on_status, topics=scene.topics,
                            on_image=feed.on_image, name=NODE), images=True) as runner:
        try:
            while not stopped and (viewer is None or viewer.running):
                runner.spin(FLUSH_PERIOD)
                feed.flush()
            scene.finish()
        except ViewError:
            pass  # the user has closed the viewer
    print(feed.report())
    return 0
