# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags with messages of smart_tire_msgs: read by name, and as the standard topics."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

from mcap.reader import make_reader
import pytest
from rosbags.highlevel import AnyReader
from smart_tire.bags import Bag, BagWriter, channel_of, match_by_name, TopicNames
from smart_tire.bags.cdr import typestore
from smart_tire.checks import findings
from smart_tire.checks.recording import read
from smart_tire.errors import BagError, ParameterError
from smart_tire.estimation.streams import INPUTS
from smart_tire.messages import definitions, TOPICS, TYPED
from smart_tire.parameters import RobotParams
from smart_tire.samples import (
    FilmDeflection, Friction, GroundState, PathProgress, TireSample, TireSamples, WheelSlip)
from smart_tire.uncertain import Uncertain
from support.recordings import (
    standard, START_NS, stream, typed, write_bag, write_with_rosbags)

EVENTS = sorted((*stream(0.5), *((START_NS + 10**8, name, sample) for name, sample in {
    'wheel_slip': WheelSlip(START_NS, (0.1, 0.2, 0.3, 0.4), (1.0,) * 4, (0.01,) * 4),
    'ground_state': GroundState(START_NS, Uncertain(25.0, 1.5)),
    'film_deflection': FilmDeflection(START_NS, Uncertain(4e-3, 1e-4)),
    'tire_friction': Friction(START_NS, 'front_left', Uncertain(0.7, 0.02)),
    'path_progress': PathProgress(START_NS, 2.5, -0.125, 2)}.items())), key=lambda event: event[0])
BATCH = TYPED['tire_samples']


@pytest.fixture(scope='module')
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of the standard topics."""
    return write_bag(tmp_path_factory.mktemp('bags') / 'plain', EVENTS)


@pytest.fixture(scope='module')
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the same in typed messages, where there are some."""
    return write_bag(tmp_path_factory.mktemp('bags') / 'typed', typed(EVENTS))


def contents(path: Path) -> list[tuple[str, str]]:
    """Return topics and samples of a bag."""
    with Bag(path) as bag:
        found = sorted((name, repr(sample)) for _, name, sample in bag.samples(TOPICS))
        assert not [*bag.faults.lines(), *bag.losses.lines(), *bag.type_mismatches()]
    return found


def test_either_form_is_read_as_the_same_samples(plain, other):
    assert not {'/tire_samples', '/wheel_slip'} & Bag(other).topics.keys()
    assert contents(other) == contents(plain)
    assert len(contents(plain)) == len(EVENTS)


def test_batches_have_the_samples_from_which_they_were_made():
    assert Counter(map(repr, (sample for _, _, sample in standard(typed(EVENTS))))) \
        == Counter(repr(sample) for _, _, sample in EVENTS)


def test_sqlite_bags_of_rosbags_are_read(tmp_path, plain):
    assert contents(write_with_rosbags(tmp_path / 'bag', typed(EVENTS))) == contents(plain)


def test_the_doctor_finds_the_same(plain, other):
    texts = []
    for path in (plain, other):
        with Bag(path) as bag:
            texts.append([str(one) for one in findings(read(bag, RobotParams()))])
    assert texts[0] == texts[1]
    assert any('tire_samples' in text for text in texts[0])


def test_of_both_forms_the_standard_one_is_read(tmp_path):
    events = [(ns, name, replace(sample, volts=((0.0, 0.0),) * len(sample.volts)))
              for ns, name, sample in typed(EVENTS) if isinstance(sample, TireSamples)]
    path = write_bag(tmp_path / 'bag', sorted((*EVENTS, *events), key=lambda event: event[0]))
    with Bag(path) as bag:
        assert bag.match(INPUTS)['tire_samples'] == '/tire_samples'
        films = [sample for _, _, sample in bag.samples(['tire_samples'])]
    assert films == [sample for _, name, sample in EVENTS if name == 'tire_samples']


def test_both_forms_in_a_namespace_count_once():
    def kinds(*names):
        return {name: (TYPED if name.endswith('/typed') else TOPICS)[
            name.removesuffix('/typed').partition('/')[2]].type for name in names}

    found = match_by_name(['tire_samples', 'odom', 'imu/data'], kinds(
        'a/tire_samples', 'a/tire_samples/typed', 'b/odom', 'b/tire_samples/typed'))
    assert found == {'tire_samples': 'b/tire_samples/typed', 'odom': 'b/odom'}
    assert match_by_name(['tire_samples'], {'/tire_samples/typed': 'std_msgs/msg/Bool'}) == {}


def test_a_topic_of_another_name_may_have_either_form(tmp_path):
    with Bag(write_bag(tmp_path / 'bag', [
            event for event in typed(EVENTS) if event[1] == BATCH.name])) as bag:
        bag.names = TopicNames({'tire_samples': BATCH.name})
        assert len(list(bag.samples(['tire_samples']))) == sum(
            name == 'tire_samples' for _, name, _ in EVENTS)
        bag.names = TopicNames({'odom': BATCH.name})
        with pytest.raises(BagError, match='expected nav_msgs/msg/Odometry$'):
            bag.match(['odom'])
    with pytest.raises(ParameterError, match='not a standard topic'):
        TopicNames({BATCH.name: '/films'})


def test_invalid_batches_are_counted_under_the_standard_name(tmp_path):
    events = [(ns, name, replace(sample, wheel='middle') if isinstance(sample, TireSamples)
               else sample) for ns, name, sample in typed(EVENTS)]
    with Bag(write_bag(tmp_path / 'bag', events)) as bag:
        assert not [one for _, _, one in bag.samples(INPUTS) if isinstance(one, TireSample)]
        assert bag.faults.rejected == Counter(
            tire_samples=sum(name == BATCH.name for _, name, _ in events))


def test_typed_messages_are_replayed_as_standard_ones(plain, other):
    renamed = {f'/{topic.name}': f'/{name}' for name, topic in TYPED.items()
               if f'/{topic.name}' in Bag(other).topics}
    with Bag(plain) as expected, Bag(other) as bag:
        found = sorted((renamed.get(channel.topic, channel.topic), bytes(data))
                       for _, channel, data in bag.replayable(bag.topics, renamed))
        assert found == sorted((channel.topic, bytes(data)) for _, channel, data in expected.raw())


def test_messages_of_the_standard_type_are_replayed_as_they_are(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(channel_of('/mti/imu', TOPICS['imu/data'].type))
        writer.write('/mti/imu', START_NS, b'\x00\x01\x00\x00unreadable')
    with Bag(tmp_path / 'bag') as bag:
        assert list(bag.replayable(bag.topics, {'/mti/imu': 'imu/data'})) == list(bag.raw())
        assert len(list(bag.raw())) == 1


def test_bags_carry_the_definitions_with_all_nested_types(other):
    with next(other.glob('*.mcap')).open('rb') as file:
        schemas = {one.name: one for one in make_reader(file).get_summary().schemas.values()}
    for name in definitions().keys() & schemas.keys():
        text = schemas[name].data.decode()
        assert schemas[name].encoding == 'ros2msg'
        assert 'MSG: std_msgs/Header' in text and 'MSG: builtin_interfaces/Time' in text
        assert ('MSG: smart_tire_msgs/Estimate' in text) == ('Estimate ' in text)
    assert definitions().keys() - schemas.keys() == {'smart_tire_msgs/msg/Estimate'}
    assert 'uint8 ARRIVED=2' in schemas['smart_tire_msgs/msg/PathProgress'].data.decode()


def test_rosbags_reads_the_bag_by_its_own_definitions(other):
    with AnyReader([other]) as reader:
        assert reader.typestore is not typestore()
        found = {connection.topic: reader.deserialize(data, connection.msgtype)
                 for connection, _, data in reader.messages()}
    assert found['/wheel_slip/typed'].ratio.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert found['/tire_friction/typed'].friction_coefficient.value == 0.7
    assert found['/tire_friction/typed'].header.frame_id == 'front_left'
    progress = found['/path_progress/typed']
    assert progress.state == progress.ARRIVED
    assert len(found['/tire_samples/typed'].volts) % 2 == 0
