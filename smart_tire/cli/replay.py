"""``smart_tire replay``: a bag onto topics."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from smart_tire.cli._arguments import positive
from smart_tire.cli._output import print_counts, print_losses
from smart_tire.errors import BagError

if TYPE_CHECKING:
    from smart_tire.bags import Bag

NAME = 'replay'
HELP = 'publish what the estimators need from a bag, at the pace at which it was received'
INPUTS = ('imu/data', 'wheel_states', 'tire_samples')
CLOCK = '/clock'
FAILED = 1
NOTABLY_SLOWER = 0.9  # of the rate that was asked for


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
    parser.add_argument('--wait-for', nargs='+', default=[], metavar='NODE',
                        help='wait for these nodes instead; without them nothing is published')


def run(args: argparse.Namespace) -> int:
    """
    Publish the bag; print the messages by topic.

    The status is 1 where a node or an estimator was not ready, or did not take all messages. That
    nobody listens to a topic is only a warning.
    """
    from smart_tire.bags import Bag
    with Bag(args.bag) as bag:
        names = chosen(bag, args.topics, everything=args.all, clock=args.clock)
        if not names:
            print(f'smart_tire replay: {args.bag} has none of {", ".join(INPUTS)}; it has '
                  f'{listed(bag)}', file=sys.stderr)
            return FAILED
        from smart_tire.nodes.replayer import replay
        result = replay(bag, names, rate=args.rate, clock=args.clock, wait=args.wait,
                        wait_for=args.wait_for)
        print_losses(bag.losses)
    if any(result.counts.values()) or not result.failures:
        print(f'{args.bag}: published' + ('' if result.complete else ', not all of it'))
        print_counts(result.counts)
    for name, type_name in result.missing.items():
        print(f'left out: {name}, for {type_name} is not installed')
    if result.complete:
        for name in result.followers:
            print(f'{name} took all of it in the order of reception')
    if result.complete and result.rate < NOTABLY_SLOWER * args.rate:
        print(f'{result.rate:.2g} times as fast as recorded: the estimators take no more')
    for failure in result.failures:
        print(f'smart_tire replay: {failure}', file=sys.stderr)
    return FAILED if result.failures else 0


def chosen(bag: Bag, topics: Sequence[str], *, everything: bool, clock: bool) -> list[str]:
    """
    Return the names in ``bag`` of the topics to publish, the inputs if no others are asked for.

    Raises BagError if one of ``topics`` is not there.
    """
    found = {topic: find(bag, topic, topics) for topic in topics}
    if absent := [topic for topic, name in found.items() if name is None]:
        raise BagError(f'{bag.path} has no {", ".join(absent)}; it has {listed(bag)}')
    names = [name for name in found.values() if name is not None]
    if everything:
        names += harmless(bag, clock=clock)
    elif not topics:
        names += bag.match(INPUTS).values()
    return list(dict.fromkeys(names))


def find(bag: Bag, wanted: str, together: Sequence[str] = ()) -> str | None:
    """
    Return the name in ``bag`` of a topic, with or without its namespace; None if none.

    Topics of the contract that are wanted ``together`` are those of one robot.
    """
    from smart_tire.messages import TOPICS
    name = wanted.strip('/')
    for found in bag.topics:
        if found.strip('/') == name:
            return found
    if name in TOPICS:
        return bag.match({name, *TOPICS.keys() & {topic.strip('/') for topic in together}}).get(
            name)
    return min((found for found in bag.topics if found.endswith(f'/{name}')), key=len,
               default=None)


def harmless(bag: Bag, *, clock: bool) -> list[str]:
    """Return all topics but commands: what was ordered once must not move a robot again."""
    from smart_tire.messages import find_topic
    return [name for name in bag.topics if not (clock and name == CLOCK)
            and ((topic := find_topic(name)) is None or topic.quality != 'command')]


def listed(bag: Bag) -> str:
    """Return the topics of ``bag`` as a list for the user."""
    return ', '.join(bag.topics) or 'no topics'
