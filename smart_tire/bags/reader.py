# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Reader of rosbag2 bags: directories or single files, MCAP or sqlite3, intact or damaged.

The files are not read with rosbags because it rejects damaged files, is slower, and skips topics
whose QoS profiles are written differently in metadata.yaml and in the file.
"""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
import heapq
from itertools import chain, islice
import logging
import math
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType

import numpy as np

from smart_tire.bags.cdr import Decoder, decoder, Encoder, SampleDecoder, SampleEncoder
from smart_tire.bags.clock_steps import (
    ClockSteps, Corrector, has_pause, host_steps, NO_STEPS, stamp_steps, Times, WheelTurns)
from smart_tire.bags.file_bytes import max_unpacked
from smart_tire.bags.metadata import add_warning, Channel, Losses, Message, Metadata
from smart_tire.bags.opening import OpenFiles
from smart_tire.bags.topic_names import (
    candidates, match_by_name, RECOGNIZED, STANDARD_NAMES, TopicNames, WHEELS_TOPIC)
from smart_tire.errors import MessageError
from smart_tire.messages import (
    find_topic, NodeStatus, resolved_joints, stamp_in, stamp_of, statuses_from_msg, TOPICS)
from smart_tire.parameters import JointParams, STANDARD_JOINTS
from smart_tire.recording import Faults, SampleArrays
from smart_tire.samples import Four, MotorCommand, NS_PER_S, Sample, WheelSample

DIAGNOSTICS, DIAGNOSTICS_TYPE = 'diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'
PARAMETERS_KEY = 'smart_tire.parameters'  # of the custom data: text of a ROS parameter file
CLOCKED = 'imu/data', WHEELS_TOPIC  # topics whose receptions show a clock that was set
PROGRESS_MESSAGES = 1000  # between two reports of progress
MAX_TIME_NS = 1 << 62     # of reception, in 2116; a later one is no time
MAX_JOINT_MESSAGES = 100  # in which all publishers of a JointState topic occur
# Of recordings from before wheel_states.effort was a torque; it was the duty of the motors.
MAX_DUTY = 1.0
DUTY_TOLERANCE = 1e-3   # -, a board rounds a duty to 3e-5; torques agree by chance only
RECENT_COMMANDS = 8     # of which one caused the effort
BLOCK_MESSAGES = 1000   # that are decoded together
SAMPLES_TO_DECIDE = 50  # wheel samples with an effort
MIN_SAMPLES = 5
MIN_AGREEING = 0.8      # of the wheel samples; the driver limits some commands, e.g. in a stop

logger = logging.getLogger(__name__)
Progress = Callable[[float], None]  # is called with the completed share, 0 to 1


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag."""

    channel: Channel
    messages: int


class Bag:
    """
    A bag, open for reading.

    ``names`` are standard topics with other names in the bag, ``joints`` the wheels in its
    ``wheel_states``. Without them, topics and joints are recognized if they are unambiguous;
    ``notes`` lists those. Reading continues after damage and after invalid messages: ``losses``
    are what could not be read so far, ``faults`` counts the invalid messages per topic. A closed
    bag with losses is reported to the logger of this module.
    """

    def __init__(self, path: str | Path, names: TopicNames = STANDARD_NAMES,
                 joints: JointParams = STANDARD_JOINTS) -> None:
        self.path = Path(path)
        self.names, self.joints = names, joints
        self.notes: list[str] = []
        self._joint_names: dict[str, list[tuple[str, ...]]] = {}
        self.faults = Faults()
        self._warnings: list[str] = []
        self.losses = Losses()
        self._stepped_span: tuple[int, int] | None = None
        self._opened = OpenFiles(self.path, self._warnings, self.losses)
        self._files = self._opened.files

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all files."""
        self._opened.close()
        report_losses(self.path, self.losses.lines())

    @property
    def warnings(self) -> list[str]:
        """Return what else is wrong with the bag."""
        return self._warnings + [warning for file in self._files for warning in file.warnings]

    @cached_property
    def topics(self) -> dict[str, BagTopic]:
        """Return the topics by name in the bag; without index this reads the whole bag."""
        channels: dict[str, Channel] = {}
        counts: Counter[str] = Counter()
        for file in self._files:
            for channel, count in file.counts().items():
                channels.setdefault(channel.topic, channel)
                counts[channel.topic] += count
        listed, found = self._opened.metadata.messages, counts.total()
        if found < listed:
            self.losses.missing = listed - found
            self.losses.add(f'{listed} are listed in metadata.yaml, {found} in the files')
        return {topic: BagTopic(channel, counts[topic]) for topic, channel in channels.items()}

    @property
    def span_ns(self) -> tuple[int, int]:
        """
        Return the receive times of the first and last message [ns]; zeros without messages.

        By the first clock, of the messages that were read, if it was found to be set meanwhile.
        """
        return self._stepped_span or (self._file_span if self._has_times else self._stamped_span)

    @cached_property
    def _stamped_span(self) -> tuple[int, int]:
        times = [receive_ns for receive_ns, _, _ in self.raw()]
        return min(times), max(times)

    @cached_property
    def _file_span(self) -> tuple[int, int]:
        spans = [span for file in self._files if (span := file.span()) is not None]
        if not spans:
            return 0, 0
        return min(start for start, _ in spans), max(end for _, end in spans)

    @cached_property
    def _has_times(self) -> bool:
        """Return whether the messages have times of reception; add a warning."""
        (start, end), early = self._file_span, self._received_before_clock
        if start >= 0 and end < MAX_TIME_NS and not early and (start < end or sum(
                one.messages for one in self.topics.values()) < MIN_SAMPLES):
            return True
        add_warning(self._warnings, 'invalid times of reception (' + (
            '0, of a recorder with use_sim_time before it received /clock' if early else
            ' to '.join(f'{one} ns' for one in dict.fromkeys((start, end))))
                    + '): those of header.stamp are used')
        return False

    @property
    def _received_before_clock(self) -> bool:
        """Return whether inputs are received at 0, but only the first ones, and stamped later."""
        start, end = self._file_span
        names = [name for name, kind in self.types.items()
                 if kind in {TOPICS[topic].type for topic in CLOCKED}]
        first = (next(file.messages(names, as_written=True), None) for file in self._files)
        return start == 0 < end and any(
            one is not None and one[0] == 0 and stamp_in(one[2]) > NS_PER_S for one in first)

    @cached_property
    def custom_data(self) -> dict[str, str]:
        """Return the texts stored with ``ros2 bag record --custom-data`` or by this package."""
        return {key: text for one in self._metadata for key, text in one.custom_data.items()}

    @property
    def max_content(self) -> int:
        """Return how many bytes of messages the files may have, compressed as they are."""
        return max_unpacked(self._opened.size)

    @property
    def ros_distro(self) -> str:
        """Return the ROS distribution that recorded the bag; '' if unknown."""
        return next((one.ros_distro for one in reversed(self._metadata) if one.ros_distro), '')

    @cached_property
    def _metadata(self) -> list[Metadata]:
        """Return the metadata in the files, and finally that in metadata.yaml."""
        return [*(one for file in self._files for one in file.metadata()), self._opened.metadata]

    @property
    def parameters(self) -> str:
        """Return the text of the ROS parameter file that is stored in the bag; '' if none is."""
        return self.custom_data.get(PARAMETERS_KEY, '')

    def match(self, wanted: Iterable[str]) -> dict[str, str]:
        """
        Return standard name -> name in the bag of those topics of ``wanted`` that the bag has.

        These are the topics in ``names``, then those with the standard name in the namespace with
        the most matches (``match_by_name``), then for ``imu/data`` and ``wheel_states`` the only
        suitable topic of the same type. Raises BagError if a topic of ``names`` is missing.
        """
        wanted, types = tuple(wanted), self.types
        found = self.names.remapped(wanted, types)
        free = {name: kind for name, kind in types.items() if name not in found.values()}
        found |= match_by_name((name for name in wanted if name not in found), free)
        for standard in RECOGNIZED:
            if standard in wanted and standard not in found and (
                    len(suitable := self.suitable(standard)) == 1):
                found[standard] = suitable[0]
                add_warning(self.notes, f'{standard}: using {suitable[0]}, the only topic of type '
                            f'{types[suitable[0]]}{RECOGNIZED[standard]}')
        if WHEELS_TOPIC in found:
            self._note_joints(found[WHEELS_TOPIC])
        return {standard: found[standard] for standard in wanted if standard in found}

    def suitable(self, standard: str) -> list[str]:
        """Return the topics of the type of ``standard`` that may be it under another name."""
        taken = {name.strip('/') for name in self.names.remap.values()}
        return [name for name in candidates(standard, self.types)
                if self.topics[name].messages and name.strip('/') not in taken
                and (standard != WHEELS_TOPIC or self.wheel_joints(name) is not None)]

    def joint_names(self, name: str) -> list[tuple[str, ...]]:
        """Return the different lists of joints in the first messages of a JointState topic."""
        if name not in self._joint_names:
            read = decoder(TOPICS[WHEELS_TOPIC].type)
            found: dict[tuple[str, ...], None] = {}
            for _, _, data in islice(self.raw({name}), MAX_JOINT_MESSAGES):
                try:
                    found[tuple(read(data).name)] = None
                except MessageError:
                    continue  # is counted when the messages are read
            self._joint_names[name] = list(found)
        return self._joint_names[name]

    def type_mismatches(self) -> list[str]:
        """Return the topics with a standard name but another message type."""
        return [f'{name} is {self.types[name]}' for name in self.topics
                if find_topic(name) is not None and self._has_other_type(name)]

    def clock_offset(self, standard: str, name: str) -> float | None:
        """Return reception minus header.stamp [s] of the first valid message of a topic."""
        first = next(self._samples({standard: name}, Faults()), None)
        if first is None:
            return None
        receive_ns, _, sample = first
        return (receive_ns - sample.stamp_ns) / NS_PER_S if sample.stamp_ns else 0.0

    def raw(self, topics: Collection[str] | None = None, *, as_written: bool = False
            ) -> Iterator[Message]:
        """
        Yield the messages of ``topics`` (names as in the bag) in order of receive time.

        ``as_written``: in the order of the files. So they are if times of reception are invalid;
        those of header.stamp replace them.
        """
        if not self._has_times:
            return self._stamped(topics)
        streams = [file.messages(topics, as_written=as_written) for file in self._files]
        if as_written:
            return chain.from_iterable(streams)
        return streams[0] if len(streams) == 1 else heapq.merge(*streams, key=itemgetter(0))

    def _stamped(self, topics: Collection[str] | None) -> Iterator[Message]:
        """Yield the messages as written, with stamps, or the time before, for invalid times."""
        (start, end), latest = self._file_span, 0
        for file in self._files:
            for receive_ns, channel, data in file.messages(topics, as_written=True):
                times = (receive_ns, stamp_in(data))[start == end:]
                latest = next((one for one in times if 0 < one < MAX_TIME_NS), latest)
                yield latest, channel, data

    def replayable(self, topics: Collection[str],
                   renamed: Mapping[str, str] = MappingProxyType({})) -> Iterator[Message]:
        """
        Yield the messages of ``topics`` as ``raw`` does, without efforts that are duties.

        Those of typed topics in ``renamed`` are converted to the type of their standard topic.
        """
        duties = {name for name in topics if name in self.topics and self._ignores_efforts(name)}
        joints = TOPICS['wheel_states'].type
        read, write = Decoder(joints), Encoder(joints)
        converted = {name: (SampleDecoder(topic.name, self.faults, type_name=self.types[name]),
                            SampleEncoder(topic)) for name, standard in renamed.items()
                     if (topic := find_topic(standard)) and topic.type != self.types[name]}
        for receive_ns, channel, data in self.raw(topics):
            if channel.topic in duties:
                msg = read(data)
                msg.effort = ()
                data = write(msg)
            if channel.topic in converted:
                samples, encode = converted[channel.topic]
                yield from ((receive_ns, channel, encode(sample)) for sample in samples(data))
            else:
                yield receive_ns, channel, data

    def samples(self, wanted: Iterable[str], *, restamp: bool = True
                ) -> Iterator[tuple[int, str, Sample]]:
        """
        Yield receive time [ns], standard topic name and sample.

        Covers the topics of ``wanted`` that are in the bag, in order of receive time. Efforts of
        ``wheel_states`` that are duties, in a bag from before they were torques, are left out.
        Times are those of the first clock if clocks were set meanwhile (``clock_steps``).
        With ``restamp`` the receive time replaces a timestamp of zero.
        """
        found = self.match(wanted)
        duties = 'wheel_states' in found and self._ignores_efforts(found['wheel_states'])
        steps = self.clock_steps(found)
        self.faults.clock_steps = tuple(steps.lines(self.span_ns[0]))
        self.faults.pauses = [(one.begin_ns, one.end_ns, one.turned) for one in steps.pauses]
        for line in self.faults.clock_steps:
            add_warning(self.notes, line)
        for receive_ns, standard, sample in self._samples(found, self.faults, steps):
            if duties and isinstance(sample, WheelSample):
                sample = replace(sample, effort=None)
            if restamp and not sample.stamp_ns:
                sample = replace(sample, stamp_ns=receive_ns)
                add_warning(self.notes, f'{standard}: header.stamp is zero, the time of '
                                        'reception is used instead')
            yield receive_ns, standard, sample

    def recording(self, wanted: Iterable[str], progress: Progress = lambda share: None, *,
                  restamp: bool = True) -> SampleArrays:
        """
        Return the samples of ``wanted`` as arrays, like ``samples``.

        ``progress`` is called with the completed share, 0 to 1.
        """
        found, (start, end) = SampleArrays(), self.span_ns
        for count, (receive_ns, _, sample) in enumerate(self.samples(wanted, restamp=restamp)):
            found.add_sample(sample, receive_ns)
            if count % PROGRESS_MESSAGES == 0:
                progress((receive_ns - start) / max(1, end - start))
        return found

    def clock_steps(self, found: Mapping[str, str]) -> ClockSteps:
        """Return the clocks that were set, by the topics ``found``: standard name -> name."""
        times = self._times(found.values())
        clocked = [own for name, own in times.items() if len(own.stamp_ns)
                   and name in (found.get(topic) for topic in CLOCKED)]
        turns = WheelTurns.of(self._samples(
            {WHEELS_TOPIC: found[WHEELS_TOPIC]}, Faults())) if WHEELS_TOPIC in found and any(
                map(has_pause, clocked)) else None
        steps = host_steps(clocked, turns)
        if steps.host:
            times = self._times(times, Corrector(steps))
            ends = [int(end()) for one in times.values() if len(one.receive_ns)
                    for end in (one.receive_ns.min, one.receive_ns.max)]
            self._stepped_span = min(ends), max(ends)
        return replace(steps, stamps={name: stepped for name, own in times.items()
                                      if (stepped := stamp_steps(own))})

    def _times(self, names: Iterable[str], correct: Corrector | None = None) -> dict[str, Times]:
        """Return the times of the topics ``names``, those of reception by the first clock."""
        found = {name: (array('q'), array('q')) for name in names}
        for receive_ns, channel, data in self.raw(found, as_written=True):
            received, stamps = found[channel.topic]
            received.append(correct('', receive_ns)[0] if correct else receive_ns)
            stamps.append(stamp_in(data))
        return {name: Times(*map(np.asarray, own)) for name, own in found.items()}

    def statuses(self) -> Iterator[tuple[int, NodeStatus]]:
        """Yield the diagnostic statuses of all nodes with their timestamps [ns]."""
        names = {name for name, topic in self.topics.items()
                 if name.rpartition('/')[2] == DIAGNOSTICS
                 and topic.channel.type == DIAGNOSTICS_TYPE and topic.channel.encoding == 'cdr'}
        read = Decoder(DIAGNOSTICS_TYPE)
        for _, channel, data in self.raw(names) if names else ():
            try:
                msg = read(data)
                stamp_ns = stamp_of(msg)
            except MessageError as error:
                self.faults.reject(channel.topic, error)
            else:
                yield from ((stamp_ns, status) for status in statuses_from_msg(msg))

    def _samples(self, found: Mapping[str, str], faults: Faults,
                 steps: ClockSteps = NO_STEPS) -> Iterator[tuple[int, str, Sample]]:
        readers = {name: (standard, SampleDecoder(
                       standard, faults, *self._joints_of(standard, name), self.types[name]))
                   for standard, name in found.items() if name in self.types}
        correct = Corrector(steps) if steps.host or steps.stamps else None
        messages = self.raw(readers, as_written=steps.back)
        if correct is None:
            yield from _decoded(messages, readers)
            return
        for receive_ns, channel, data in messages:
            standard, read = readers[channel.topic]
            receive_ns, ahead_ns = correct(channel.topic, receive_ns)
            for sample in read(data, ahead_ns):
                yield receive_ns, standard, sample

    def _joints_of(self, standard: str, name: str) -> tuple[JointParams, bool]:
        """Return the wheels of a topic, and whether some messages may have other joints."""
        joints = self.wheel_joints(name) if standard == WHEELS_TOPIC else None
        return joints or self.joints, joints is not None

    def wheel_joints(self, name: str) -> JointParams | None:
        """Return the wheels among the joints of a topic; None if it has none."""
        for names in self.joint_names(name):
            joints = resolved_joints(names, self.joints)
            if {joint for joint in joints.names if joint} <= set(names):
                return joints
        return None

    def _note_joints(self, name: str) -> None:
        joints = self.wheel_joints(name)
        if joints is not None and self.joints.is_standard and not joints.is_standard:
            add_warning(self.notes, f'wheel_states: the wheels are the joints '
                                    f'{", ".join(dict.fromkeys(joints.names))}, by their names')

    def _ignores_efforts(self, name: str) -> bool:
        """Return whether ``name`` is wheel_states whose efforts are duties; add a warning."""
        topic, commands = find_topic(name), name.removesuffix('wheel_states') + 'motor_commands'
        if (topic is None or topic.name != 'wheel_states' or commands not in self.topics
                or self._has_other_type(name) or self._has_other_type(commands)):
            return False
        found = {'wheel_states': name, 'motor_commands': commands}
        duties = efforts_are_duties(
            sample for _, _, sample in self._samples(found, Faults()))
        if duties:
            add_warning(self._warnings, 'wheel_states: effort contains duties, no torques (old '
                                        'recording): not used')
        return duties

    @cached_property
    def types(self) -> dict[str, str]:
        """Return the message types by name in the bag."""
        return {name: topic.channel.type if topic.channel.encoding == 'cdr'
                else f'{topic.channel.type} in {topic.channel.encoding}'
                for name, topic in self.topics.items()}

    def _has_other_type(self, name: str) -> bool:
        topic = find_topic(name)
        return topic is None or self.types[name] != topic.type


def _decoded(messages: Iterator[Message], readers: Mapping[str, tuple[str, SampleDecoder]]
             ) -> Iterator[tuple[int, str, Sample]]:
    """Yield the samples in ``messages``, of which many are decoded together."""
    while block := list(islice(messages, BLOCK_MESSAGES)):
        by_topic: defaultdict[str, list[bytes]] = defaultdict(list)
        for _, channel, data in block:
            by_topic[channel.topic].append(data)
        found = {name: (*readers[name], iter(readers[name][1].block(same)))
                 for name, same in by_topic.items()}
        for receive_ns, channel, data in block:
            standard, read, samples = found[channel.topic]
            if (sample := next(samples)) is not None:
                yield receive_ns, standard, sample
            else:
                yield from ((receive_ns, standard, one) for one in read(data))


def report_losses(path: Path, lines: Iterable[str]) -> None:
    """Report the losses of the bag at ``path`` to the logger; the latest report is complete."""
    for line in lines:
        logger.warning('%s: %s', path, line)


def efforts_are_duties(samples: Iterable[Sample]) -> bool:
    """
    Return whether the efforts of wheel samples are duties, by ``motor_commands``.

    They are if no effort exceeds 1 and they agree with the latest commands. ``samples`` are both,
    in order of reception; no more are read than are needed.
    """
    commands: deque[Four] = deque(maxlen=RECENT_COMMANDS)
    agreeing = count = 0
    for sample in samples:
        if isinstance(sample, MotorCommand):
            commands.append(sample.duty)
        elif isinstance(sample, WheelSample) and sample.effort and any(sample.effort):
            if any(math.isnan(one) or abs(one) > MAX_DUTY for one in sample.effort):
                return False
            count += 1
            agreeing += any(_agree(sample.effort, duty) for duty in commands)
            if count == SAMPLES_TO_DECIDE:
                break
    return count >= MIN_SAMPLES and agreeing >= MIN_AGREEING * count


def _agree(effort: Four, duty: Four) -> bool:
    return all(abs(one - other) < DUTY_TOLERANCE for one, other in zip(effort, duty))
