"""What several verbs ask of their arguments."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from smart_tire.cli._overwrite import add_force


def positive(text: str) -> float:
    """Return the number in ``text``; raise ValueError unless it is above zero and finite."""
    number = float(text)
    if not 0.0 < number < float('inf'):
        raise ValueError(text)
    return number


def not_negative(text: str) -> float:
    """Return the number in ``text``; raise ValueError unless it is zero or more, and finite."""
    number = float(text)
    if not 0.0 <= number < float('inf'):
        raise ValueError(text)
    return number


def add_recordings(parser: argparse.ArgumentParser, *, reference: bool = True) -> None:
    """
    Ask for bags, which part of them to read, and where to write what they tell.

    Without ``reference`` poses to compare with are not asked for.
    """
    parser.add_argument('bags', type=Path, nargs='+', metavar='BAG',
                        help='rosbag2 folder, or a file of one')
    parser.add_argument('--params', type=Path, action='append', default=[], metavar='FILE',
                        help='ROS parameter file of what is known before; may be repeated')
    parser.add_argument('--from', dest='since', type=not_negative, default=0.0, metavar='S',
                        help='seconds after the start of each bag to read from')
    parser.add_argument('--until', type=positive, default=math.inf, metavar='S',
                        help='seconds after the start of each bag to read up to')
    if reference:
        parser.add_argument('--reference', metavar='TOPIC',
                            help='poses to compare with, or none; found by itself unless given')
    parser.add_argument('--out', type=Path, metavar='FILE',
                        help='parameter file to write, and a figure of its name beside it '
                             '(default: <bag>_KIND.yaml here)')
    add_force(parser)


def out_beside(args: argparse.Namespace, kind: str) -> Path:
    """Return the file to write to: the one asked for, or one named after the first bag."""
    if args.out is not None:
        return Path(args.out)
    bag = args.bags[0].resolve()
    return Path(f'{bag.name if bag.is_dir() else bag.stem}_{kind}.yaml')
