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

"""``smart_tire status``: nodes, diagnostics, rates and safety state on one screen."""

from __future__ import annotations

import argparse
import os
import time
from typing import TYPE_CHECKING

from smart_tire.cli._arguments import positive

if TYPE_CHECKING:
    from rich.console import Console
    from smart_tire.cli._status_board import StatusBoard
    from smart_tire.nodes.observer import Observer
    from smart_tire.nodes.runner import NodeRunner

NAME = 'status'
HELP = ('show nodes, diagnostics, rates and safety state of all robots in this ROS domain, until '
        'Ctrl-C; exit status 0 if all are ok, 1 with warnings, 2 with errors or without nodes')
REFRESH_PERIOD = 0.5  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('--once', action='store_true',
                        help='print once and exit; always so without a terminal')
    parser.add_argument('--json', action='store_true', help='print JSON once and exit')
    parser.add_argument('--seconds', type=positive, default=5.0, metavar='S',
                        help='how long to listen with --once or --json (default: 5)')


def run(args: argparse.Namespace) -> int:
    """Show the status; return the exit status of the latest one."""
    from rich.console import Console
    from smart_tire.cli._status_board import StatusBoard
    from smart_tire.nodes.observer import Observer
    from smart_tire.nodes.runner import NodeRunner
    console, name = Console(), f'status_{os.getpid()}'
    board = StatusBoard(name)

    def new_observer() -> Observer:
        return Observer(lambda topic, data: board.add_message(topic, data, time.monotonic()),
                        lambda status: board.add_status(status, time.monotonic()), name=name)

    with NodeRunner(new_observer, []) as runner:
        if args.once or args.json or not console.is_terminal:
            runner.spin(args.seconds)
        else:
            _show(console, board, runner)
        return _finish(args, console, board)


def _show(console: Console, board: StatusBoard, runner: NodeRunner[Observer]) -> None:
    """Show the status until Ctrl-C."""
    from rich.live import Live
    from smart_tire.cli._status_view import view
    with Live(console=console, auto_refresh=False, screen=True) as live:
        try:
            while True:
                runner.spin(REFRESH_PERIOD)
                live.update(view(board.robots(time.monotonic())), refresh=True)
        except KeyboardInterrupt:
            return


def _finish(args: argparse.Namespace, console: Console, board: StatusBoard) -> int:
    """Print the latest status; return the exit status."""
    from smart_tire.cli._status_view import to_json, view
    now = time.monotonic()
    status, robots = board.exit_status(now), board.robots(now)
    if args.json:
        print(to_json(robots, status))
    else:
        console.print(view(robots))
    return status
