# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Names of the standard topics in a bag: given with ``--remap``, or found, or what to give."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from smart_tire.errors import BagError, ParameterError
from smart_tire.messages import find_topic, forms_of, TOPICS

SEPARATOR = ':='
WHEELS_TOPIC = 'wheel_states'
# Topics that are recognized by their type, and what else must hold.
RECOGNIZED = {'imu/data': '', WHEELS_TOPIC: ' with joints of wheels'}
Types = Mapping[str, str]  # name of a topic in the bag -> type of its messages


@dataclass(frozen=True)
class TopicNames:
    """Standard topic name -> name in the bag, for those topics that are named differently."""

    remap: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.remap:
            if name not in TOPICS:
                raise ParameterError(f'--remap {name}{SEPARATOR}{self.remap[name]}: {name} is not '
                                     f'a standard topic, expected one of {", ".join(TOPICS)}')

    @classmethod
    def parse(cls, rules: Iterable[str]) -> TopicNames:
        """
        Return the names in ``rules`` such as ``imu/data:=/mti30/imu``.

        Raises ParameterError if a rule has another form, or if two contradict each other.
        """
        remap: dict[str, str] = {}
        for rule in rules:
            standard, separator, name = rule.partition(SEPARATOR)
            standard = standard.strip('/')
            if not (standard and separator and name):
                raise ParameterError(
                    f'--remap {rule}: expected STANDARD{SEPARATOR}NAME, such as '
                    f'imu/data{SEPARATOR}/mti30/imu')
            if remap.setdefault(standard, name) != name:
                raise ParameterError(f'--remap {rule}: {standard} is already {remap[standard]}')
        return cls(remap)

    def remapped(self, wanted: Iterable[str], types: Types) -> dict[str, str]:
        """
        Return standard name -> name in the bag of those topics of ``wanted`` that are remapped.

        Raises BagError if the bag with the topics ``types`` lacks one, or if its type is wrong.
        """
        found = {}
        for standard in wanted:
            if standard not in self.remap:
                continue
            given = self.remap[standard].strip('/')
            name = next((name for name in types if name.strip('/') == given), None)
            if name is None:
                raise BagError(f'--remap {standard}{SEPARATOR}{self.remap[standard]}: the bag has '
                               f'no {self.remap[standard]}; its topics: '
                               f'{", ".join(types) or "none"}')
            if types[name] not in (forms := forms_of(standard)):
                raise BagError(f'--remap {standard}{SEPARATOR}{name}: {name} is {types[name]}, '
                               f'expected {" or ".join(forms)}')
            found[standard] = name
        return found


STANDARD_NAMES = TopicNames()


def match_by_name(wanted: Iterable[str], types: Types) -> dict[str, str]:
    """
    Return standard name -> name in the bag of those topics of ``wanted`` that have that name.

    A name in the bag may have a namespace. If several namespaces match, all topics are taken from
    the namespace with the most matches, so that topics of two robots are never mixed. A typed
    topic is taken if the namespace lacks the other one, whose name is shorter.
    """
    found: dict[str, dict[str, str]] = {name: {} for name in wanted}  # name in bag -> namespace
    for name, kind in types.items():
        topic = find_topic(name)
        if topic is not None and topic.standard in found and kind == topic.type:
            found[topic.standard][name] = name.strip('/')[:-len(topic.name)].strip('/')
    spaces = Counter(space for names in found.values() for space in set(names.values()))
    return {standard: min(names, key=lambda name: (-spaces[names[name]], len(name), name))
            for standard, names in found.items() if names}


def candidates(standard: str, types: Types) -> list[str]:
    """Return the topics of the type of ``standard`` that have no standard name of their own."""
    return [name for name, kind in types.items()
            if kind == TOPICS[standard].type and find_topic(name) is None]
