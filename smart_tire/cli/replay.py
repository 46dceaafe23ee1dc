# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire replay``: publish the messages of a bag."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from datetime import timedelta
import math
import sys
import time
from typing import TYPE_CHECKING

from smart_tire.cli._bags import print_counts, print_warnings, REQUIRED
from smart_tire.cli._progress import ProgressLine, Rate
from smart_tire.errors import BagError, did_you_mean
from smart_tire.estimation.streams import REPLAYED

if TYPE_CHECKING:
    from smart_tire.bags import Bag

CLOCK = '/clock'
FAILED = 1
MIN_RATE_SHARE = 0.9  # of the requested rate; a slower replay is reported


class ReplayStatus:
    """Progress of the replay of a bag of ``duration`` [s] as text."""

    def __init__(self, duration: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._duration, self._clock = duration, clock  # s
        self._rate = Rate()

    def text(self, position: float) -> str:
        """Return position in the bag, duration, rate and remaining time."""
        rate = self._rate.since(position, self._clock())
        share = min(1.0, position / self._duration) if self._duration > 0.0 else 1.0
        text = f'{duration(position)} of {duration(self._duration)}  {share:4.0%}'
        if rate is None or rate <= 0.0:
            return text
        left = duration(math.ceil((self._duration - position) / rate))
        return f'{text}  {rate:.3g} times the recorded rate  {left} left'


def duration(seconds: float) -> timedelta:
    """Return a duration in whole seconds, which is printed as hours, minutes and seconds."""
    return timedelta(seconds=max(0, int(seconds)))


def run(args: argparse.Namespace) -> int:
    """
    Publish the bag; print the message count of each topic.

    The status is 1 if a node or an estimator was not ready or did not receive all messages. A
    topic without subscribers is only a warning.
    """
    from smart_tire.bags import Bag, TopicNames
    with Bag(args.bag, TopicNames.parse(args.remap)) as bag:
        names = chosen(bag, args.topics, everything=args.all, clock=args.clock)
        renamed = standard_names(bag, names)
        if not names:
            print(f'smart_tire replay: {args.bag} has none of {", ".join(REPLAYED)}; its topics: '
                  f'{listed(bag)}', file=sys.stderr)
            return FAILED
        from smart_tire.nodes.replayer import replay
        start_ns, end_ns = bag.span_ns
        status = ReplayStatus((end_ns - start_ns) * 1e-9)
        with ProgressLine(timer=False) as progress:
            result = replay(bag, names, rate=args.rate, clock=args.clock, wait=args.wait,
                            wait_for=args.wait_for, renamed=renamed,
                            on_progress=lambda position: progress.show(status.text(position)))
        print_warnings(bag.warnings)
    if any(result.counts.values()) or not result.failures:
        print(f'{args.bag}: published' + ('' if result.complete else ' in part'))
        print_counts(result.counts)
        for name, standard in renamed.items():
            print(f'{name} was published as {standard}')
    for name, type_name in result.missing.items():
        print(f'skipped: {name} ({type_name} is not installed)')
    if result.complete:
        for name in result.followers:
            print(f'{name} processed all messages in recorded order')
    if result.complete and result.rate < MIN_RATE_SHARE * args.rate:
        print(f'{result.rate:.2g} times the recorded rate: limited by the estimators')
    for failure in result.failures:
        print(f'smart_tire replay: {failure}', file=sys.stderr)
    return FAILED if result.failures else 0


def chosen(bag: Bag, topics: Sequence[str], *, everything: bool, clock: bool) -> list[str]:
    """
    Return the names in ``bag`` of the topics to publish; by default those of the inputs.

    Raises BagError if the bag lacks one of ``topics``, or if an input has to be selected.
    """
    from smart_tire.bags import check_inputs
    if not topics and not everything:
        check_inputs(bag, REQUIRED)
    found = {topic: find(bag, topic, topics) for topic in topics}
    if absent := [topic for topic, name in found.items() if name is None]:
        raise BagError(f'{bag.path} has no {", ".join(absent)}' + did_you_mean(
            absent[0], bag.topics, f'; its topics: {listed(bag)}'))
    names = [name for name in found.values() if name is not None]
    if everything:
        names += without_commands(bag, clock=clock)
    elif not topics:
        names += bag.match(REPLAYED).values()
    return list(dict.fromkeys(names))


def standard_names(bag: Bag, names: Sequence[str]) -> dict[str, str]:
    """
    Return name in the bag -> standard name for those of ``names`` that are named otherwise.

    A typed topic keeps its namespace.
    """
    from smart_tire.messages import find_topic, TOPICS
    found = {}
    for standard, name in bag.match(TOPICS).items():
        topic = find_topic(name)
        if name in names and (topic is None or topic.name != standard):
            space = '' if topic is None else name.removesuffix(topic.name)
            found[name] = space + standard
    return found


def find(bag: Bag, wanted: str, together: Sequence[str] = ()) -> str | None:
    """
    Return the name in ``bag`` of topic ``wanted``, given with or without namespace, or None.

    Standard topics that are requested ``together`` are taken from one namespace.
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


def without_commands(bag: Bag, *, clock: bool) -> list[str]:
    """Return all topics except commands, which must not move a robot again."""
    from smart_tire.messages import find_topic
    return [name for name in bag.topics if not (clock and name == CLOCK)
            and ((topic := find_topic(name)) is None or topic.quality != 'command')]


def listed(bag: Bag) -> str:
    """Return the topic names of ``bag`` as text."""
    return ', '.join(bag.topics) or 'none'
