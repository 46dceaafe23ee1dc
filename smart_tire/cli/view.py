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

"""``smart_tire view``: a recording, or live topics, in the rerun viewer."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
import os
from pathlib import Path
import sys
import time
from typing import TYPE_CHECKING
import webbrowser

from smart_tire.cli._options import (
    add_bag_options, add_force, BagSettings, open_bag, refuse_existing)
from smart_tire.cli._progress import Progress
from smart_tire.cli._stack import ANNOUNCED, end_with_parent

if TYPE_CHECKING:
    from smart_tire.analysis.pipeline import EstimatorParams
    from smart_tire.view.bag import Recording
    from smart_tire.view.scene import Scene
    from smart_tire.view.viewer import Viewer

    Show = Callable[[Scene, Viewer | None], int]

NAME = 'view'
HELP = 'show a bag, or live topics, in the rerun viewer; needs no ROS distribution'
USAGE = 2            # exit status
LIVE_NAME = 'live'
CHECK_PERIOD = 0.2   # s, in which a closed viewer is noticed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('bag', type=Path, nargs='?', metavar='BAG',
                        help='rosbag2 directory, a single bag file, or the output folder of '
                             '"smart_tire demo" or "smart_tire analyze"')
    parser.add_argument('--live', action='store_true',
                        help='show the topics of the running nodes (needs rclpy)')
    add_bag_options(parser)
    parser.add_argument('--estimate', action='store_true',
                        help='compute the estimates instead of showing those in the bag')
    parser.add_argument('--no-fit', action='store_true',
                        help=argparse.SUPPRESS)  # of before: nothing is fitted
    parser.add_argument('--web', action='store_true',
                        help='serve the viewer to a browser on this machine; done without a '
                             'display, too')
    parser.add_argument('--save', type=Path, metavar='FILE',
                        help='write a recording of the viewer (.rrd); without --web no viewer is '
                             'opened')
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Show the bag or the live topics; return the exit status."""
    if args.live == (args.bag is not None) or args.live and args.estimate:
        print('smart_tire view: expected either BAG or --live; --estimate is for a BAG',
              file=sys.stderr)
        return USAGE
    if args.save is not None:
        refuse_existing([args.save], force=args.force, inputs=[*args.params])
    from smart_tire.analysis.pipeline import EstimatorParams
    from smart_tire.view.bag import find_recording
    if args.live:
        # Importing rclpy may restart Python, so it must come before the viewer is started.
        from smart_tire.cli._live_view import show_live
        return _with_viewer(args, LIVE_NAME, EstimatorParams.load(args.params), show_live)
    recording = find_recording(args.bag)
    with open_bag(recording.bag, args, required=()) as (_, settings):
        pass  # an error before the viewer appears
    return _with_viewer(args, recording.bag.resolve().name, settings.params,
                        partial(_show_bag, args, recording, settings))


def has_display(environment: Mapping[str, str]) -> bool:
    """Return whether programs can open windows."""
    return bool(environment.get('DISPLAY') or environment.get('WAYLAND_DISPLAY'))


def _with_viewer(args: argparse.Namespace, name: str, params: EstimatorParams,
                 show: Show) -> int:
    """Start the viewer, call ``show(scene, viewer)`` and stop a viewer for browsers."""
    from smart_tire.view.layout import Layout
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
        layout = Layout(params.robot.film.wheels, live=args.live)
        stream = open_stream(name, layout.blueprint(), file=args.save,
                             address=viewer.address.stream if viewer else None)
        status = show(Scene(stream, params.robot), viewer)
        stream.disconnect()
        if args.save is not None:
            print(f'written to {args.save}')
        return status


def _show_bag(args: argparse.Namespace, recording: Recording, settings: BagSettings,
              scene: Scene, viewer: Viewer | None) -> int:
    """Show a recording; wait while a viewer for browsers is served."""
    from smart_tire.view.bag import show
    with Progress(recording.bag.name) as progress:
        show(recording, scene, settings.params, estimate=args.estimate,
             describe=partial(print, flush=True), progress=progress.share, names=settings.names)
    if viewer is not None and viewer.address.web is not None:
        try:
            while viewer.running:
                time.sleep(CHECK_PERIOD)
        except KeyboardInterrupt:
            print()
    return 0
