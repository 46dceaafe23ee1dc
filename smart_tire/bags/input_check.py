# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Whether a bag has the inputs of the estimators; which topics and joints may be meant."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from smart_tire.bags.reader import Bag
from smart_tire.bags.topic_names import candidates, RECOGNIZED, SEPARATOR, WHEELS_TOPIC
from smart_tire.errors import BagError, printable
from smart_tire.messages import TOPICS

MAX_LISTED = 12  # topics of a bag
MAX_CLOCK_DIFFERENCE = 30.0  # s; a recorder on a busy machine may be late by less
JOINTS_EXAMPLE = """\
  /**:
    ros__parameters:
      joints:
        front_left: NAME    # '': no encoder
        front_right: NAME
        rear_left: NAME
        rear_right: NAME
or, with one wheel or one motor per side, joints: {left: NAME, right: NAME}"""


class ChoiceError(BagError):
    """A topic is missing that the bag may have by another name: a table of what may be meant."""

    def __str__(self) -> str:
        return '\n'.join(map(printable, OSError.__str__(self).splitlines()))


def check_inputs(bag: Bag, wanted: Collection[str]) -> None:
    """
    Raise ChoiceError if a topic of ``wanted`` is missing that the bag may have by another name.

    The message lists what may be meant and the option or parameter that selects it. Also raises
    BagError if the topics have timestamps of different clocks.
    """
    found = bag.match(wanted)
    for standard in wanted:
        if standard == WHEELS_TOPIC and (message := _joints_message(bag, found.get(standard))):
            raise ChoiceError(message)
        if standard not in found and (message := _topics_message(bag, standard)):
            raise ChoiceError(message)
    _check_clocks(bag, found)


def contents(bag: Bag) -> tuple[str, str]:
    """Return which topics a bag has, and what to do if the inputs are not among them."""
    listed = [f'{name} ({kind}, {bag.topics[name].messages})' for name, kind in bag.types.items()]
    if more := len(listed) - MAX_LISTED:
        listed[MAX_LISTED:] = [f'{more} more'] if more > 0 else []
    encodings = {topic.channel.encoding for topic in bag.topics.values()} - {'cdr'}
    joints = sorted({name for topic in candidates(WHEELS_TOPIC, bag.types)
                     for names in bag.joint_names(topic) for name in names})
    return f'the bag has {printable(", ".join(listed) or "no topics")}', (
        'name the joints of the wheels in a parameter file, by joints.*: '
        + printable(', '.join(joints)) if joints and not bag.suitable(WHEELS_TOPIC) else
        'they are of ROS 1: convert their .bag file with rosbags-convert' if 'ros1' in encodings
        else 'write their messages as samples, with smart_tire.bags.BagWriter.write_sample'
        if encodings else 'record this topic, or select it by its name with --remap')


def _check_clocks(bag: Bag, found: Mapping[str, str]) -> None:
    """Raise BagError if topics have timestamps of different clocks."""
    offsets = {standard: offset for standard, name in found.items()
               if (offset := bag.clock_offset(standard, name)) is not None}
    if offsets and max(offsets.values()) - min(offsets.values()) > MAX_CLOCK_DIFFERENCE:
        raise BagError(f'{bag.path}: timestamps are of different clocks: header.stamp is ' + ', '
                       .join(f'{offset:.6g} s before reception on {standard}'
                             for standard, offset in offsets.items()))


def _topics_message(bag: Bag, standard: str) -> str:
    """Return the choice between several topics that ``standard`` may be; '' if there is none."""
    names = bag.suitable(standard) if standard in RECOGNIZED else []
    if not names:
        return ''
    width = max(map(len, names))
    return '\n'.join((
        f'{bag.path}: {len(names)} topics may be {standard}; select one:',
        *(f'  --remap {standard}{SEPARATOR}{name:{width}}  {TOPICS[standard].type}, '
          f'{bag.topics[name].messages} messages' for name in names)))


def _joints_message(bag: Bag, name: str | None) -> str:
    """Return the joints of ``wheel_states`` if the wheels are not among them; else ''."""
    names = [name] if name else [
        other for other in candidates(WHEELS_TOPIC, bag.types) if bag.topics[other].messages]
    lists = {other: bag.joint_names(other) for other in names}
    if any(map(bag.wheel_joints, names)) or not any(lists.values()):
        return ''
    wanted = ', '.join(dict.fromkeys(filter(None, bag.joints.names)))
    found = '\n'.join(f'  {other}: {_listed(lists[other])}' for other in names if lists[other])
    reason = ('the joints of the wheels are not recognized' if bag.joints.is_standard else
              f'the joints {wanted} of the parameters joints.* are not in the bag')
    return (f'{bag.path}: {reason}. Joints by topic:\n{found}\n'
            f'Name those of the wheels in a parameter file (--params FILE):\n{JOINTS_EXAMPLE}')


def _listed(lists: Sequence[tuple[str, ...]]) -> str:
    return ', '.join(dict.fromkeys(joint for names in lists for joint in names))
