# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The node ``film_sensor`` in virtual time, and its driver and device on a pseudo-terminal."""

from __future__ import annotations

from contextlib import closing
from functools import partial
import time

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from smart_tire.bags.cdr import empty
from smart_tire.drivers.sample_stream import FILM_CHARGE, SampleStream
from smart_tire.drivers.serial_port import open_port
from smart_tire.errors import MessageError
from smart_tire.messages import TOPICS, TYPED
from smart_tire.nodes import base
from smart_tire.nodes.film_driver import FilmDriver
from smart_tire.nodes.film_sensor import FilmSensorNode
from smart_tire.nodes.film_simulator import FilmSimulator
from smart_tire.parameters.film import FilmSensorParams
from smart_tire.protocol.film_charge import encode_charge, encode_frame
from smart_tire.samples import FilmCharge, FilmDeflection, FilmTemperature, NS_PER_S
from support.command import command
from support.films import (
    calibration, charge_of, EPOCH_NS, measured, samples_of, strokes, write_calibration)
from support.recordings import write_bag
from support.virtual_node import local, virtual
from support.waiting import PATIENCE

pytestmark = pytest.mark.processes
few_examples = settings(max_examples=100, deadline=None, derandomize=True)


@pytest.fixture(scope='module')
def film_file(tmp_path_factory):
    """Return the file of a calibrated film."""
    return str(write_calibration(tmp_path_factory.mktemp('film') / 'film.yaml'))


@pytest.fixture
def node(isolated_ros, film_file):
    """Return a node in virtual time."""
    with virtual(FilmSensorNode, calibration_file=film_file, fresh=True) as made:
        yield made


def inputs(seconds=2.0):
    """Return the charge of a motion, and the temperature, in the order of their stamps."""
    temperatures = [FilmTemperature(EPOCH_NS + round(0.1 * k * NS_PER_S), 20.0, 0.02)
                    for k in range(round(10 * seconds))]
    return sorted([*samples_of(charge_of(strokes(seconds))), *temperatures],
                  key=lambda one: one.stamp_ns)


def publish(node, samples):
    for one in samples:
        node.publish('film_charge' if isinstance(one, FilmCharge) else 'film_temperature', one)


def test_live_estimates_are_those_of_the_estimator_offline(node):
    publish(node, inputs())
    live = [(one.stamp_ns, *one.deflection) for one in node.samples('film_deflection')]
    offline = measured(inputs(), node.params, calibration())
    assert len(live) > 900
    for (stamp_ns, *values), row in zip(live, offline):
        assert ((stamp_ns - EPOCH_NS) / NS_PER_S, *values) == pytest.approx(
            tuple(row), nan_ok=True, rel=1e-9)
    assert max(value for _, value, _ in live[600:]) == pytest.approx(0.01, rel=0.02)


def seconds(sample: FilmDeflection) -> float:
    """Return the time [s] since the begin of the inputs."""
    return (sample.stamp_ns - EPOCH_NS) / NS_PER_S


def test_a_replay_gives_the_estimates_of_the_recorded_samples_offline(graph, film_file, tmp_path):
    rng, topics = np.random.default_rng(1), ('film_temperature', 'film_charge')
    events = sorted([(one.stamp_ns + round(rng.uniform(0.0, 0.03) * NS_PER_S),
                      topics[isinstance(one, FilmCharge)], one) for one in inputs()],
                    key=lambda event: event[0])
    offline = measured([one for _, _, one in events], FilmSensorParams(fresh=True))
    bag = write_bag(tmp_path / 'bag', events)
    with command('replay', bag, '--rate', 20, '--wait', PATIENCE, '--wait-for', 'film_sensor',
                 'test') as player, graph.start(
                     'film_sensor', calibration_file=film_file, fresh=True):
        graph.subscribe('film_deflection')
        graph.until(graph.has_publishers)
        graph.subscribe('film_charge')  # the replay begins
        graph.until(lambda: not player.running)
        assert player.end() == 0, player.output
        graph.until(lambda: graph.samples('film_deflection', 1)
                    and seconds(graph.samples('film_deflection')[-1]) == offline[-1, 0])
    # those before the node has discovered the subscription are not received
    found = {seconds(one): one.deflection for one in graph.samples('film_deflection')}
    expected = [row for row in offline if row[0] in found]
    assert len(expected) == len(found)
    np.testing.assert_allclose([(time, *one) for time, one in found.items()], expected, rtol=1e-9)
    assert np.isfinite(offline[:, 1]).sum() > 600
    assert 'film_sensor processed all messages in recorded order' in player.output


def test_the_flat_film_is_zeroed_by_the_service_while_it_is_measured(node):
    assert not node.call('zero_film').success
    assert 'must be at rest' in node.health().message
    publish(node, inputs(1.4))
    assert node.call('zero_film').success
    assert node.health().values['zeros'] == '2'


def test_the_deflection_is_published_as_a_typed_message_too(isolated_ros, film_file, monkeypatch):
    monkeypatch.setattr(base, 'installed_class', lambda name: partial(empty, name))
    typed = TYPED['film_deflection']
    with virtual(FilmSensorNode, calibration_file=film_file, fresh=True) as made:
        made.subscribers[typed.name] = 1
        publish(made, inputs(1.0))
        assert str([typed.from_msg(msg) for msg in made.received[typed.name]]) == str(
            made.samples('film_deflection'))
        assert made.received[typed.name]


@pytest.mark.parametrize('topic', ['film_charge', 'film_temperature', 'film_deflection'])
@few_examples
@given(values=st.lists(st.floats(), max_size=4), names=st.lists(st.sampled_from(
    ['charge', 'saturated', 'deflection', '']), max_size=4), efforts=st.lists(
        st.floats(), max_size=2))
def test_any_message_is_read_or_refused(topic, values, names, efforts):
    msg = empty(TOPICS[topic].type)
    if topic == 'film_temperature':
        msg.temperature, msg.variance = [*values, 0.0, 0.0][:2]
    else:
        msg.name, msg.position, msg.effort = names, values, efforts
    try:
        sample = TOPICS[topic].from_msg(msg)
    except MessageError:
        return
    assert TOPICS[topic].from_msg(TOPICS[topic].to_msg(
        empty(TOPICS[topic].type), sample)).stamp_ns == sample.stamp_ns


def test_bad_messages_are_counted_and_change_nothing(node):
    bad = FilmCharge(EPOCH_NS, 1.0)  # one coulomb
    for one in inputs(1.2):
        publish(node, [one])
        if isinstance(one, FilmTemperature):
            node.publish('film_charge', bad)
    assert node.inputs['film_charge'].bad == 12
    assert node.samples('film_deflection')[-1].deflection.sigma < 1e-3


def test_the_driver_publishes_what_the_device_sends(isolated_ros, port):
    port.plug_in()
    with local(FilmDriver, port=port.path) as node:
        node.until(lambda: node.health().values['port_opened'] == '1')
        for k in range(20):
            port.write(encode_frame(encode_charge(2_000_000 * k, FilmCharge(0, 1e-10 * k))))
            node.until(lambda: len(node.received['film_charge']) == k + 1)  # noqa: B023
        port.write(bytes(500))
        node.until(lambda: node._source.bytes_skipped == 500)
        assert node.health().values['stamps'] == 'device clock'
    assert [one.charge for one in node.samples('film_charge')] == pytest.approx(
        [1e-10 * k for k in range(20)], abs=1e-13)


def test_the_simulated_device_opens_its_port_and_publishes_the_truth(isolated_ros, tmp_path):
    path, stream = str(tmp_path / 'film'), SampleStream(FILM_CHARGE)
    found = []
    with virtual(FilmSimulator, port=f'simulated:{path}', loss=0.0) as device, \
            closing(open_port(path, 115200)) as port:
        device.until(lambda: len(found) > 100, lambda: found.extend(
            stream.receive(port.read(port.in_waiting), time.time_ns())))
        assert device.samples('film_temperature')[0].value == 20.0
        assert device.samples('ground_truth/film_deflection')[0].deflection == (0.0, 0.0)
    assert stream.frames_bad == 0
