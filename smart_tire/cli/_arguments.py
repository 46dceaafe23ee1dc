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

"""Arguments that several verbs share."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from smart_tire.cli._bags import add_bag_options
from smart_tire.cli._overwrite import add_force


def positive(text: str) -> float:
    """Return ``text`` as a number; raise ValueError unless it is positive and finite."""
    number = float(text)
    if not 0.0 < number < float('inf'):
        raise ValueError(text)
    return number


def not_negative(text: str) -> float:
    """Return ``text`` as a number; raise ValueError unless it is non-negative and finite."""
    number = float(text)
    if not 0.0 <= number < float('inf'):
        raise ValueError(text)
    return number


def add_recordings(parser: argparse.ArgumentParser, *, reference: bool = True) -> None:
    """
    Add the arguments for input bags, time range, parameters and output file.

    With ``reference`` also an argument for the topic of reference poses.
    """
    parser.add_argument('bags', type=Path, nargs='+', metavar='BAG',
                        help='rosbag2 directory or a single bag file')
    add_bag_options(parser)
    parser.add_argument('--from', dest='since', type=not_negative, default=0.0, metavar='S',
                        help='skip the first S seconds of each bag (default: 0)')
    parser.add_argument('--until', type=positive, default=math.inf, metavar='S',
                        help='stop S seconds after the start of each bag (default: read all)')
    if reference:
        source = parser.add_mutually_exclusive_group()
        source.add_argument('--truth', dest='reference', action='store_const', const='any',
                            default='none', help='use the reference poses in the bags '
                            '(ground_truth/odom or overhead/odom); by default they are not used')
        source.add_argument('--reference', metavar='TOPIC',
                            help='like --truth, with the topic of the reference poses')
    parser.add_argument('--out', type=Path, metavar='FILE',
                        help='parameter file to write; a figure with the same name is written '
                             'next to it (default: <bag>_KIND.yaml in the working directory)')
    add_force(parser)


def output_path(args: argparse.Namespace, kind: str) -> Path:
    """Return the output file: ``--out``, or a name derived from the first bag."""
    if args.out is not None:
        return Path(args.out)
    bag = args.bags[0].resolve()
    return Path(f'{bag.name if bag.is_dir() else bag.stem}_{kind}.yaml')
