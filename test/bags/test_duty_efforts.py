# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Efforts of old recordings are duties: recognized by the commands, and left out."""

from dataclasses import replace
import math

import pytest
from smart_tire.bags import Bag, BagWriter, channel_of
from smart_tire.bags.cdr import Decoder, empty, Encoder
from smart_tire.bags.reader import efforts_are_duties
from smart_tire.messages import TOPICS
from smart_tire.messages.joint_state import wheels_from_msg
from smart_tire.samples import MotorCommand, WheelSample
from support.recordings import START_NS

SPEED = (5.0, 5.0, 5.0, 5.0)


def duties(number):
    """Return the duties of command ``number``."""
    return tuple(0.3 + 0.1 * math.sin(0.3 * number + wheel) for wheel in range(4))


def run(count, effort, commands=True):
    """Return receive times, topics and samples; ``effort`` of each wheel sample by number."""
    events = []
    for number in range(count):
        now_ns = START_NS + 62_500_000 * number
        if commands:
            events.append((now_ns, 'motor_commands', MotorCommand(now_ns, duties(number))))
        events.append((now_ns + 3_000_000, 'wheel_states',
                       WheelSample(now_ns, SPEED, SPEED, effort(number))))
    return events


def samples_of(events):
    return [sample for _, _, sample in events]


def acknowledged(number):
    """Return the duties of an old driver: of an earlier command, rounded by the board."""
    return tuple(round(duty * 32767) / 32767 for duty in duties(max(number - 2, 0)))


def test_efforts_that_agree_with_the_commands_are_duties():
    assert efforts_are_duties(samples_of(run(40, acknowledged)))


def test_some_duties_may_differ_from_the_commands_as_in_a_stop():
    assert efforts_are_duties(samples_of(run(
        60, lambda number: (0.01,) * 4 if number % 10 == 9 else acknowledged(number))))


@pytest.mark.parametrize('effort', [
    lambda number: tuple(1.5 * duty for duty in duties(number)),         # torques below 1 N m
    lambda number: (*duties(number)[:3], 0.9),                           # one wheel differs
    lambda number: (0.0,) * 4, lambda number: None,                      # nothing to decide by
    lambda number: (*acknowledged(number)[:3], 1.2 if number == 7 else acknowledged(number)[3]),
    lambda number: (*acknowledged(number)[:3], math.nan)])
def test_other_efforts_are_torques(effort):
    assert not efforts_are_duties(samples_of(run(60, effort)))


def torques(number):
    """Return efforts that agree with no command."""
    return tuple(2.0 * duty for duty in duties(number))


@pytest.mark.parametrize(('count', 'are_duties'), [(4, False), (5, True)])
def test_a_few_samples_are_too_few_to_decide(count, are_duties):
    assert efforts_are_duties(samples_of(run(count, acknowledged))) is are_duties


@pytest.mark.parametrize(('others', 'are_duties'), [(10, True), (11, False)])
def test_at_least_four_fifths_of_fifty_samples_agree(others, are_duties):
    events = run(50, lambda number: (0.01,) * 4 if number < others else acknowledged(number))
    rest = run(50, lambda number: (0.01,) * 4)  # are not read
    assert efforts_are_duties(samples_of(events + rest)) is are_duties


@pytest.mark.parametrize(('difference', 'are_duties'), [(0.9e-3, True), (1.1e-3, False)])
def test_duties_agree_up_to_their_rounding(difference, are_duties):
    assert efforts_are_duties(samples_of(run(
        20, lambda number: tuple(duty - difference for duty in duties(number))))) is are_duties


@pytest.mark.parametrize(('age', 'are_duties'), [(7, True), (8, False)])
def test_a_duty_is_that_of_one_of_the_latest_eight_commands(age, are_duties):
    events = run(50, lambda number: duties(number - age))[2 * age:]
    assert efforts_are_duties(samples_of(events)) is are_duties


@pytest.mark.parametrize(('effort', 'are_duties'), [(1.0, True), (1.001, False), (-1.1, False)])
def test_a_duty_is_at_most_1(effort, are_duties):
    events = run(20, lambda number: (effort,) * 4, commands=False)
    commands = [(0, 'motor_commands', MotorCommand(0, (effort,) * 4))]
    assert efforts_are_duties(samples_of(commands + events)) is are_duties


def test_without_commands_efforts_are_torques():
    assert not efforts_are_duties(samples_of(run(60, acknowledged, commands=False)))


def write(path, events, prefix='/'):
    """Write ``events`` into a bag, topics with ``prefix``; return its path."""
    with BagWriter(path) as writer:
        for receive_ns, name, sample in events:
            topic = TOPICS[name]
            writer.add_topic(channel_of(prefix + name, topic.type))
            writer.write(prefix + name, receive_ns,
                         Encoder(topic.type)(topic.to_msg(empty(topic.type), sample)))
    return path


@pytest.mark.parametrize('prefix', ['/', '/robot_1/'])
def test_a_bag_gives_no_efforts_if_they_are_duties_and_warns_once(tmp_path, prefix):
    with Bag(write(tmp_path / 'old', run(60, acknowledged), prefix)) as bag:
        for _ in range(2):
            found = [sample for _, _, sample in bag.samples(['wheel_states'])]
            assert len(found) == 60
            assert all(sample.effort is None and sample.position == SPEED for sample in found)
        assert bag.warnings == ['wheel_states: effort contains duties, no torques (old '
                                'recording): not used']


def test_a_replay_leaves_duties_out_and_nothing_else(tmp_path):
    decode = Decoder(TOPICS['wheel_states'].type)
    with Bag(write(tmp_path / 'old', run(60, acknowledged))) as bag:
        topics = ['/wheel_states', '/motor_commands']
        for (ns, channel, data), (same_ns, same, left) in zip(
                bag.raw(topics), bag.replayable(topics), strict=True):
            assert (ns, channel) == (same_ns, same)
            if channel.topic == '/motor_commands':
                assert left == data
            else:
                before, after = wheels_from_msg(decode(data)), wheels_from_msg(decode(left))
                assert after == replace(before, effort=None) != before


def test_a_bag_gives_the_torques_of_new_recordings(tmp_path):
    events = run(60, torques)
    with Bag(write(tmp_path / 'new', events)) as bag:
        found = [sample for _, _, sample in bag.samples(['wheel_states'])]
        assert found == [sample for _, topic, sample in events if topic == 'wheel_states']
        assert list(bag.replayable(['/wheel_states'])) == list(bag.raw(['/wheel_states']))
        assert not bag.warnings
