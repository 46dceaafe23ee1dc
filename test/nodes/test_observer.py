# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Checks of the ROS graph, and the observer of all robots."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from sensor_msgs.msg import Image
from smart_tire.bags.cdr import Decoder
from smart_tire.findings import Level
from smart_tire.host_load import other_problems
from smart_tire.messages import forms_of, TOPICS, TYPED
from smart_tire.nodes import observer
from smart_tire.nodes.compat import message_class, node_names
from smart_tire.nodes.observer import (
    discovery_finding, discovery_time, Endpoint, graph_findings, Listener,
    Observer, read_graph, state_of, TopicEnds)
from smart_tire.nodes.qos import publisher_qos
from smart_tire.nodes.runner import NodeRunner
from smart_tire.samples import ImuSample
from support.virtual_node import virtual
from support.waiting import wait_for

pytestmark = pytest.mark.processes
JOINTS, IMU = TOPICS['motor_commands'].type, TOPICS['imu/data'].type
RELIABLE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SAMPLE = ImuSample(5, (0.0, 0.0, 9.81), (0.0, 0.0, 0.1))


def ends(*publishers, types=(JOINTS,), subscriptions=(), profile=RELIABLE):
    """Return the ends of a topic."""
    return TopicEnds(types, tuple(Endpoint(name, profile) for name in publishers),
                     tuple(Endpoint(name, asked) for name, asked in subscriptions))


def found(graph, nodes=()):
    """Return level and text of the findings."""
    return [f'{one.level.name} {one.text}' for one in graph_findings(graph, nodes)]


def test_one_controller_is_fine():
    assert found({'/a/motor_commands': ends('/a/wheel_controller'), '/chatter': ends(
        '/x', '/y', types=('std_msgs/msg/String',))}, ['/a/wheel_controller', '/b/x']) == []


def test_another_type_on_a_typed_topic_is_reported():
    name, typed = '/a/wheel_slip/typed', TYPED['wheel_slip'].type
    assert found({name: ends('/a/slip_estimator', types=(typed,))}) == []
    line, = found({name: ends('/a/slip_estimator', types=(JOINTS,))})
    assert line.startswith(f'ERROR {name}: has the type {JOINTS} (expected {typed}')


def test_typed_topics_are_not_observed_since_that_would_cause_them(isolated_ros):
    names = {topic.name: [topic.type] for topic in forms_of('wheel_slip').values()}
    with virtual(partial(Observer, lambda *_: None, lambda *_: None)) as node:
        node.get_topic_names_and_types = names.items
        node.get_publishers_info_by_topic = lambda _: [SimpleNamespace(qos_profile=RELIABLE)]
        node.run(0.3)
        assert [name for name in names if node.receives(name)] == ['wheel_slip']


def test_the_samples_of_all_films_are_queued(isolated_ros):
    with virtual(partial(Listener, lambda *_: None, lambda *_: None)) as node:
        assert [node.profiles[name].depth for name in ('tire_samples', 'imu/data')] == [
            16_000, 1000]


def test_an_observer_subscribes_again_only_for_a_publisher_that_offers_less(isolated_ros):
    kinds = {'/a/imu/data': IMU, '/a/motors_enabled': observer.BOOL, '/x': observer.BOOL}
    offers = []
    with virtual(partial(Observer, lambda *_: None, lambda *_: None)) as node:
        node.get_topic_names_and_types = lambda: [(name, [kind]) for name, kind in kinds.items()]
        node.get_publishers_info_by_topic = lambda _: [
            SimpleNamespace(qos_profile=one) for one in offers]
        for new, reliability in ((None, None), (RELIABLE, RELIABLE), (BEST_EFFORT, BEST_EFFORT),
                                 (RELIABLE, BEST_EFFORT)):
            offers += [new] if new else []
            node.run(0.3)
            assert [name for name in kinds if node.receives(name)] == (
                list(kinds)[:2] if offers else [])
            assert all(len(node._readers[name]) == 1 for name in kinds if node.receives(name))
            if reliability:
                assert node.profiles['/a/imu/data'].reliability == reliability.reliability
        offers.pop(1)
        before = node._observed['/a/imu/data'][1]
        node.run(0.3)
        assert node._observed['/a/imu/data'][1] is before


def test_several_and_foreign_publishers_of_commands_are_reported():
    double, foreign = found({'/a/motor_commands': ends('/a/wheel_controller', '/teleop')})
    assert double.startswith('ERROR /a/motor_commands: 2 publishers: /a/wheel_controller, /teleop')
    assert foreign.startswith('WARNING /a/motor_commands: is published by /teleop')
    assert found({'/cmd_vel': ends('/teleop', types=(TOPICS['cmd_vel'].type,))}) == []
    assert len(found({'/cmd_vel': ends('/a', '/b', types=(TOPICS['cmd_vel'].type,))})) == 1


def test_a_node_that_sends_temporarily_is_no_second_publisher_of_cmd_vel():
    kind = (TOPICS['cmd_vel'].type,)
    assert found({'/a/cmd_vel': ends('/a/trajectory_controller', '/teleop', types=kind)}) == []
    three = found({'/cmd_vel': ends('/a/trajectory_controller', '/b', '/c', types=kind)})
    assert len(three) == 1 and '2 publishers: /b, /c' in three[0]
    line, = found({'/wheel_commands': ends('/trajectory_controller')})
    assert 'is published by /trajectory_controller (expected wheel_controller)' in line


@pytest.mark.parametrize('name', ['path', 'goal_pose'])
def test_several_publishers_of_paths_and_goals_are_fine(name):
    assert found({f'/{name}': ends('/rviz', '/planner', types=(TOPICS[name].type,))}) == []


@pytest.mark.parametrize('offered', [RELIABLE, LATCHED])
def test_one_of_the_profiles_of_a_node_must_match(offered):
    both = [('/y', LATCHED), ('/y', RELIABLE)]
    assert found({'/any': ends('/x', subscriptions=both, profile=offered)}) == []
    apart = [('/y', LATCHED), ('/z', RELIABLE)]
    assert len(found({'/any': ends('/x', subscriptions=apart, profile=offered)})) == (
        offered == RELIABLE)


def test_two_nodes_with_one_name_are_an_error():
    assert found({}, ['/a', '/b', '/a']) == [
        'ERROR /a: 2 nodes have this name (expected one); end one of them, or use namespaces']


def test_another_type_is_an_error():
    line, = found({'/imu/data': ends('/x', types=('std_msgs/msg/String',))})
    assert line.startswith('ERROR /imu/data: has the type std_msgs/msg/String')
    assert len(found({'/imu/data': ends('/x', types=(IMU, 'std_msgs/msg/String'))})) == 1


@pytest.mark.parametrize('offered, requested, fails', [
    (RELIABLE, RELIABLE, False), (RELIABLE, BEST_EFFORT, False), (BEST_EFFORT, RELIABLE, True),
    (LATCHED, RELIABLE, False), (RELIABLE, LATCHED, True)])
def test_incompatible_profiles_are_an_error(offered, requested, fails):
    lines = found({'/any': ends('/x', subscriptions=[('/y', requested)], profile=offered)})
    assert [line.startswith('ERROR /any: /y does not receive what /x sends')
            for line in lines] == [True] * fails


def test_states_are_known_in_any_namespace():
    assert state_of('/a/b/motors_enabled') == 'motors_enabled'
    assert state_of('/emergency_stop_active') == 'emergency_stop_active'
    assert state_of('/motors_enabled/x') == ''


def test_an_observer_receives_from_all_namespaces_and_the_graph_is_read(graph):
    received, statuses = {}, {}

    def new_observer() -> Observer:
        return Observer(received.__setitem__,
                        lambda status: statuses.update({status.name: status}), name='watcher')

    topic, cls = TOPICS['imu/data'], message_class(IMU)
    publishers = [graph.node.create_publisher(cls, f'/{space}/imu/data', profile)
                  for space, profile in (('one', publisher_qos('imu/data')), ('two', BEST_EFFORT))]
    other = graph.node.create_publisher(message_class('std_msgs/msg/Bool'), '/three/imu/data', 1)
    with NodeRunner(new_observer, []) as runner:
        def step():
            for publisher in publishers:
                publisher.publish(topic.to_msg(cls(), SAMPLE))
            other.publish(message_class('std_msgs/msg/Bool')(data=True))
            runner.spin(0.05)

        def discovered():
            ends = read_graph(runner.node).get('/three/imu/data')
            return ends and [end.node for end in ends.publishers] == ['/test']

        graph.until(lambda: len(received) == 2 and 'watcher' in statuses and discovered(), step)
        read, names = read_graph(runner.node), node_names(runner.node)
    assert set(received) == {'/one/imu/data', '/two/imu/data'}
    assert all(topic.from_msg(Decoder(IMU)(data)) == SAMPLE for data in received.values())
    assert '/test' in names and not any('watcher' in name for name in names)
    assert [end.node for end in read['/two/imu/data'].publishers] == ['/test']
    assert read['/two/imu/data'].subscriptions == ()
    levels = {one.where: one.level for one in graph_findings(read, names)}
    assert levels == {'/three/imu/data': Level.ERROR}


def test_a_listener_passes_samples_and_diagnostics(graph):
    samples, statuses = [], {}

    def new_listener() -> Listener:
        return Listener(lambda *given: samples.append(given),
                        lambda status: statuses.update({status.name: status}),
                        topics=['imu/data'], name='ear')

    with NodeRunner(new_listener, []) as runner:
        graph.until(lambda: samples and 'ear' in statuses, lambda: (
            graph.publish('imu/data', SAMPLE), runner.spin(0.05)))
    assert samples[0] == ('imu/data', SAMPLE)
    problems = other_problems(statuses['ear'].message, statuses['ear'].values, late=True)
    assert problems in ('', 'ok')  # than of the host
    assert int(statuses['ear'].values['frames_ok']) <= len(samples)


def test_a_listener_passes_serialized_images_also_of_best_effort_publishers(graph):
    images = []

    def new_listener() -> Listener:
        return Listener(lambda *_: None, lambda _: None, topics=(),
                        on_image=lambda *given: images.append(given), name='eye')

    sent = Image(encoding='mono8', width=2, height=1, step=2, data=b'\x01\x02')
    profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = graph.node.create_publisher(Image, 'overhead_camera/image_raw', profile)
    with NodeRunner(new_listener, []) as runner:
        graph.until(lambda: images, lambda: (publisher.publish(sent), runner.spin(0.05)))
        counter = runner.node.inputs['overhead_camera/image_raw']
        assert counter.ok >= 1 and counter.bad == 0
    kind, data = images[0]
    assert kind == 'sensor_msgs/msg/Image'
    assert bytes(Decoder(kind)(data).data) == b'\x01\x02'


@pytest.mark.parametrize('found_at', [0.2, 4.9, None])
def test_discovery_is_timed_between_two_participants_which_are_ended(monkeypatch, found_at):
    now, ends, names, readers = [100.0], [], [], []

    def create_node(name, context, **options):
        names.append(name)
        return SimpleNamespace(
            create_publisher=lambda *_: SimpleNamespace(publish=lambda message: None),
            create_subscription=lambda kind, topic, callback, profile: readers.append(callback),
            destroy_node=lambda: ends.append(name))

    def spin_once(timeout_sec):
        now[0] += timeout_sec
        if found_at is not None and now[0] >= 100.0 + found_at - 1e-6:
            readers[0](True)
    monkeypatch.setattr(observer, 'Context', lambda: SimpleNamespace(
        try_shutdown=lambda: ends.append('context')))
    monkeypatch.setattr(observer, 'SingleThreadedExecutor', lambda context: SimpleNamespace(
        add_node=lambda node: None, spin_once=spin_once, shutdown=lambda: ends.append('executor')))
    monkeypatch.setattr(observer, 'rclpy', SimpleNamespace(
        init=lambda args, context: None, create_node=create_node))
    monkeypatch.setattr(observer.time, 'monotonic', lambda: now[0])
    text = discovery_finding(discovery_time(), late=True).found
    assert ('do not find each other' if found_at is None else f'({found_at:.2f} s)') in text
    assert now[0] - 100.0 == pytest.approx(found_at or 5.0, abs=0.06)
    assert len(set(names)) == 2 and ends == ['executor', names[0], 'context', names[1], 'context']


@pytest.mark.parametrize('elapsed, late, level', [
    (3.4, False, Level.OK), (3.6, False, Level.WARNING), (3.6, True, Level.OK),
    (None, False, Level.ERROR), (None, True, Level.ERROR)])
def test_slow_and_failed_discovery_are_reported(elapsed, late, level):
    assert discovery_finding(elapsed, late=late).level is level


def test_the_environment_of_discovery_is_named(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    monkeypatch.setenv('ROS_LOCALHOST_ONLY', '1')
    finding, = observer.middleware_findings()
    assert 'domain 42 (' in finding.found and 'ROS_LOCALHOST_ONLY=1' in finding.found
    assert finding.found.startswith('rmw_')


def test_participants_of_this_host_find_each_other(isolated_ros):
    wait_for(lambda: (discovery_time() or 0.0) > 0.0)  # None: not within its time
