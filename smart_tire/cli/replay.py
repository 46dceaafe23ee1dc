"""``smart_tire replay``: a bag onto topics."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from smart_tire.cli.listing import print_counts, print_losses

if TYPE_CHECKING:
    from smart_tire.bags import Bag

NAME = 'replay'
HELP = 'publish what the estimators need from a bag, at the pace at which it was received'
INPUTS = ('imu/data', 'wheel_states', 'tire_samples')
CLOCK = '/clock'
FAILED, USAGE = 1, 2


def positive(text: str) -> float:
    """Return the number in ``text``; raise ValueError unless it is above zero and finite."""
    number = float(text)
    if not 0.0 < number < float('inf'):
        raise ValueError(text)
    return number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this verb."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='rosbag2 folder, or a file of one')
    parser.add_argument('--rate', type=positive, default=1.0, metavar='R',
                        help='times as fast as recorded (default: 1)')
    parser.add_argument('--topics', nargs='+', default=[], metavar='T',
                        help=f'topics instead of {", ".join(INPUTS)}; commands only this way')
    parser.add_argument('--all', action='store_true', help='all topics but commands')
    parser.add_argument('--clock', action='store_true', help='publish /clock too')
    parser.add_argument('--wait', type=float, default=5.0, metavar='S',
                        help='longest wait for subscribers of all topics [s] (default: 5)')


def run(args: argparse.Namespace) -> int:
    """Publish the bag; print the messages by topic."""
    from smart_tire.bags import Bag
    with Bag(args.bag) as bag:
        names = {name: found for name in args.topics or ([] if args.all else INPUTS)
                 for found in [find(bag, name)]}
        absent = [name for name, found in names.items() if found is None]
        if args.topics and absent:
            print(f'smart_tire replay: {args.bag} has no {", ".join(absent)}; it has '
                  f'{", ".join(bag.topics)}', file=sys.stderr)
            return USAGE
        wanted = [found for found in names.values() if found is not None]
        wanted += [name for name in harmless(bag, args.clock) if args.all and name not in wanted]
        if not wanted:
            print(f'smart_tire replay: {args.bag} has none of {", ".join(INPUTS)}; it has '
                  f'{", ".join(bag.topics) or "no topics"}', file=sys.stderr)
            return FAILED
        from smart_tire.nodes.replayer import replay
        result = replay(bag, wanted, rate=args.rate, clock=args.clock, wait=args.wait)
        print_losses(bag.losses)
    print(f'{args.bag}: published' + ('' if result.complete else ', not all of it'))
    print_counts(result.counts)
    for name, type_name in result.missing.items():
        print(f'left out: {name}, for {type_name} is not installed')
    return 0


def find(bag: Bag, wanted: str) -> str | None:
    """Return the name in ``bag`` of a topic, with or without its namespace; None if none."""
    from smart_tire.messages import TOPICS
    name = wanted.strip('/')
    for found in bag.topics:
        if found.strip('/') == name:
            return found
    if name in TOPICS:
        return bag.match([name]).get(name)
    return min((found for found in bag.topics if found.endswith(f'/{name}')), key=len,
               default=None)


def harmless(bag: Bag, clock: bool) -> Sequence[str]:
    """Return all topics but commands: what was ordered once must not move a robot again."""
    from smart_tire.messages import find_topic
    return [name for name in bag.topics if not (clock and name == CLOCK)
            and ((topic := find_topic(name)) is None or topic.quality != 'command')]
