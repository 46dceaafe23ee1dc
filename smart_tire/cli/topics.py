# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire topics``: what the fields of each topic mean."""

from __future__ import annotations

import argparse

from smart_tire.errors import did_you_mean, ParameterError
from smart_tire.messages.describe import columns, describe, Described, topic_lines, TOPIC_NAMES


def run(args: argparse.Namespace) -> int:
    """Print the list, or the description of each given topic."""
    described = [_described(name) for name in args.topics]
    if not described:
        rows = [(topic.name, topic.summary)
                for topic in map(describe, TOPIC_NAMES) if topic is not None]
        print('\n'.join(columns(rows, '')))
        print('\n"smart_tire topics TOPIC" describes the fields of a topic.')
    for number, topic in enumerate(described):
        print('\n' * bool(number) + '\n'.join(topic_lines(topic)))
        print(f'    published by {topic.publishers}'
              + (f'; subscribers: {topic.subscribers}' if topic.subscribers else ''))
    return 0


def _described(name: str) -> Described:
    topic = describe(name)
    if topic is None:
        raise ParameterError(f'{name}: no topic of this package' + did_you_mean(
            name, TOPIC_NAMES, f'; known: {", ".join(TOPIC_NAMES)}'))
    return topic
