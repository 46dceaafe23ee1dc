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

"""``smart_tire record``: record topics into a bag."""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path

from smart_tire.cli._output import print_counts
from smart_tire.cli._overwrite import add_force, refuse_existing_bag, remove_bag

NAME = 'record'
HELP = 'record topics into a rosbag2 bag until Ctrl-C'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='new folder for the bag (default: rosbag2_<date and time>)')
    parser.add_argument('--topics', nargs='+', default=[], metavar='T',
                        help='topics to record (default: all, including those that appear later)')
    parser.add_argument('--params', type=Path, action='append', default=[], metavar='FILE',
                        help='ROS parameter file to store in the bag, for recordings without '
                             'nodes of this package; may be repeated')
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """
    Record until interrupted; print the message count of each topic.

    Lost messages are reported, but do not change the exit status.
    """
    directory = args.out or Path(f'rosbag2_{datetime.now():%Y_%m_%d-%H_%M_%S}')
    refuse_existing_bag(directory, force=args.force)
    from smart_tire.analysis.pipeline import EstimatorParams
    parameters = EstimatorParams.load(args.params).by_node() if args.params else None
    from smart_tire.nodes.recorder import record
    remove_bag(directory)
    recording = record(directory, args.topics, parameters)
    print(f'{directory}:')
    print_counts(recording.counts)
    for line in recording.losses:
        print(line)
    return recording.status
