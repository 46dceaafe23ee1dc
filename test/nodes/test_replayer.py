# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The replayer in virtual time: pacing, lockstep, readiness of estimators, clock, progress."""

from __future__ import annotations

from collections import Counter, defaultdict
import threading
from types import SimpleNamespace

import pytest
from rclpy.duration import Duration
from smart_tire.bags import Bag
from smart_tire.drivers.clock import Clock
from smart_tire.messages import stamp_in
from smart_tire.nodes import replayer as module
from smart_tire.nodes.lockstep import MAX_STEPS_AHEAD
from smart_tire.nodes.replayer import Replayer
from smart_tire.samples import NS_PER_S
from support.recordings import START_NS, stream, write_bag

pytestmark = pytest.mark.processes

TOPICS = ('/imu/data', '/odom', '/tire_samples')


class Host(Clock):
    """The steady time of a host that wakes up late by up to 3 ms, once by half a second."""

    def __init__(self):
        self.now, self.waits, self.stalled_until = 1, 0, 0  # ns; a steady clock is not 0

    def now_ns(self):
        return self.now

    def wait(self, event, seconds):
        self.waits += 1
        self.now += round(seconds * 1e9) + self.waits % 4 * 1_000_000
        if self.waits == 50:
            self.now += 500_000_000
            self.stalled_until = self.now
        return event.is_set()


class Graph:
    """The node, executor and lockstep leader of a replayer: nothing is sent."""

    def __init__(self, host):
        self.host, self.sent, self.log, self.steps = host, [], [], []
        self.events = []                     # times [s] and what happens then
        self.readers = defaultdict(list)     # topic -> nodes that subscribe to it, in the graph
        self.matched = Counter()             # topic -> subscriptions that have matched
        self.nodes = set()                   # names of other nodes
        self.followers, self.able, self.not_ready = [], set(), {}
        self.done, self.ended, self.announced, self.waits = -1, False, [], []

    def create_publisher(self, kind, name, profile):
        return SimpleNamespace(
            topic_name=name, qos_profile=profile, wait_for_all_acked=self.waits.append,
            publish=lambda data: self.sent.append((self.host.now, name, data)),
            get_subscription_count=lambda: self.matched[name])

    def get_subscriptions_info_by_topic(self, topic):
        profile = self.profile
        return [SimpleNamespace(node_name=name, node_namespace='/', qos_profile=profile)
                for name in self.readers[topic]]

    def get_node_names_and_namespaces(self):
        return [(name, '/') for name in self.nodes]

    def get_namespace(self):
        return '/robot'

    def get_name(self):
        return 'replayer'

    def get_logger(self):
        return SimpleNamespace(info=lambda text: self.log.append((self.host.now / 1e9, text)))

    def spin_once(self, timeout_sec):
        self.host.now += round(timeout_sec * 1e9)
        while self.events and self.events[0][0] * 1e9 <= self.host.now:
            self.events.pop(0)[1]()

    def nothing(self, *_):
        pass

    add_node = remove_node = shutdown = begin = nothing

    def candidates(self):
        return self.able | set(self.followers)

    def inputs(self):
        return {'/imu/data', '/odom'}

    def unready(self):
        return self.not_ready

    def announce(self, topics):
        self.announced.append((self.host.now / 1e9, topics))

    def step(self, number, entries):
        self.steps.append((self.host.now, number, self.done, entries))

    def behind(self, number):
        return self.followers if self.done < number else []

    def end(self):
        self.ended = True


@pytest.fixture(scope='module')
def source(tmp_path_factory):
    """Return a bag with the inputs of estimators."""
    return write_bag(tmp_path_factory.mktemp('source') / 'bag', stream(1.0))


@pytest.fixture
def rig(source, monkeypatch):
    """Return the maker of a replayer and of its graph, with these values of its arguments."""
    from smart_tire.nodes.qos import latched
    graph = Graph(Host())
    graph.profile = latched()
    monkeypatch.setattr(module, 'Leader', lambda node: graph)
    monkeypatch.setattr(module, 'new_executor', lambda: graph)
    monkeypatch.setattr(module, 'replayer_qos', lambda *_: latched())
    with Bag(source) as bag:
        def make(**values):
            return graph, Replayer(graph, bag, TOPICS, **{
                'rate': 1.0, 'clock': False, 'awaited': (), 'stop': threading.Event(),
                'renamed': {}, 'host': graph.host, **values})
        yield make


def recorded(source):
    """Return time, topic and data of the messages of the bag."""
    with Bag(source) as bag:
        return [(ns, channel.topic, data) for ns, channel, data in bag.raw(TOPICS)]


@pytest.mark.parametrize('rate', [0.01, 0.5, 1.0, 7.0, 40.0])
def test_messages_are_published_at_a_multiple_of_the_recorded_rate(rig, source, rate):
    graph, replayer = rig(rate=rate)
    replayer.play()
    messages, sent = recorded(source), graph.sent
    assert [message[1:] for message in sent] == [message[1:] for message in messages]
    for (now_ns, _, _), (recorded_ns, _, _) in zip(sent, messages):
        due_ns = sent[0][0] + (recorded_ns - messages[0][0]) / rate
        assert due_ns - 500_000 <= now_ns
        assert now_ns <= max(due_ns, graph.host.stalled_until) + 3_000_000  # late, but no drift
    result = replayer.result
    assert result.counts == Counter(topic for _, topic, _ in messages)
    assert result.complete and not graph.steps
    assert graph.waits == [Duration(seconds=2)] * 3  # for the messages on their way
    elapsed_ns = graph.host.now - sent[0][0]
    assert result.rate == pytest.approx((messages[-1][0] - messages[0][0]) / max(1, elapsed_ns))


@pytest.mark.parametrize('rate', [0.5, 2.0])
def test_the_clock_ticks_at_100_hz_and_is_never_behind_a_message(rig, source, rate):
    graph, replayer = rig(rate=rate, clock=True)
    replayer.play()
    first_ns, latest_ns, ticks = recorded(source)[0][0], 0, []
    for _, name, data in graph.sent:
        if name == '/clock':
            latest_ns = data.clock.sec * NS_PER_S + data.clock.nanosec
            ticks.append(latest_ns)
    step_ns = round(rate * 10_000_000)
    assert ticks == [first_ns + index * step_ns for index in range(len(ticks))]
    assert 0 <= recorded(source)[-1][0] - ticks[-1] < step_ns
    assert graph.sent[0][1] == '/clock'


def test_the_progress_is_reported_twice_a_second_and_is_that_of_the_clock(rig):
    reports = []
    graph, replayer = rig(rate=0.1, on_progress=lambda seconds: reports.append(
        (graph.host.now / 1e9, seconds)))
    replayer.play()
    begin = graph.sent[0][0] / 1e9
    assert len(reports) >= 18
    for (earlier, _), (later, _) in zip(reports, reports[1:]):
        assert later - earlier >= 0.499
    for now, seconds in reports:
        assert seconds == pytest.approx((now - begin) * 0.1, abs=0.06)


def follow(graph, *, delay=0):
    """Let an estimator follow, which completes a step ``delay`` polls after it may."""
    graph.followers, polls = ['/slip'], [0]

    def spin_once(timeout_sec):
        graph.host.now += round(timeout_sec * 1e9)
        polls[0] += 1
        if polls[0] > delay:
            graph.done, polls[0] = graph.steps[-1][1], 0
    graph.spin_once = spin_once


@pytest.mark.parametrize('delay', [0, 2])
def test_steps_are_short_and_at_most_two_ahead_of_the_estimators(rig, source, delay):
    graph, replayer = rig(rate=40.0)
    follow(graph, delay=delay)
    replayer.play()
    assert replayer.result.complete and replayer.result.failures == []
    assert [number for _, number, _, _ in graph.steps] == list(range(len(graph.steps)))
    assert max(number - done for _, number, done, _ in graph.steps) == MAX_STEPS_AHEAD == 2
    entries = [entry for _, _, _, entries in graph.steps for entry in entries]
    assert entries == [(topic, stamp_in(data)) for _, topic, data in recorded(source)
                       if topic in graph.inputs()]


def test_a_step_has_at_most_50_messages_of_a_topic_and_20_ms(rig, source):
    _, replayer = rig()
    steps = list(replayer._steps())
    assert [event for step in steps for event in step] == recorded(source)
    sizes = [Counter(topic for _, topic, _ in step) for step in steps]
    assert max(size['/tire_samples'] for size in sizes) == 32  # a batch of both wheels
    assert all(step[-1][0] - step[0][0] <= 20_000_000 for step in steps)
    assert len(steps) <= 60


@pytest.mark.parametrize('count, sizes', [(50, [50]), (51, [50, 1]), (101, [50, 50, 1])])
def test_a_burst_of_one_topic_is_divided(rig, monkeypatch, count, sizes):
    _, replayer = rig()
    monkeypatch.setattr(replayer, '_events', lambda: [(START_NS, '/a', b'')] * count)
    assert list(map(len, replayer._steps())) == sizes


def test_a_step_is_20_ms_of_reception_at_most(rig, monkeypatch):
    _, replayer = rig()
    monkeypatch.setattr(replayer, '_events', lambda: [
        (START_NS + 1_000_000 * at, '/a', b'') for at in (0, 20, 21, 41, 42)])
    assert list(map(len, replayer._steps())) == [2, 2, 1]


@pytest.mark.parametrize('end, text', [
    (None, '/slip did not process all messages'), (5.0, '/slip ended during the replay')])
def test_a_replay_fails_if_an_estimator_hangs_or_ends(rig, end, text):
    graph, replayer = rig(rate=40.0)
    graph.followers = ['/slip']
    graph.candidates = lambda: set() if end and graph.host.now > end * 1e9 else {'/slip'}
    replayer.play()
    assert replayer.result.failures == [text] and not replayer.result.complete
    assert len(graph.steps) == MAX_STEPS_AHEAD
    assert graph.host.now / 1e9 == pytest.approx(end or 15.0, abs=0.05)


def test_a_stopped_replay_is_incomplete(rig):
    stop = threading.Event()
    graph, replayer = rig(stop=stop, rate=0.1, on_progress=lambda at: at > 0.3 and stop.set())
    replayer.play()
    assert not replayer.result.complete and 0 < replayer.result.counts['/imu/data'] < 60
    replayer.close()
    assert graph.ended


def test_an_estimator_that_starts_late_is_a_failure(rig):
    graph, replayer = rig(rate=40.0)
    graph.able, graph.readers['/odom'] = {'/late', '/elsewhere'}, ['late']
    replayer.play()
    assert replayer.result.failures == ['/late started after the replay had begun']


def test_without_names_the_replay_waits_for_a_subscription_of_each_topic(rig):
    graph, replayer = rig()
    graph.events = [(second, lambda topic=topic: graph.matched.update([topic]))
                    for second, topic in zip((1.0, 2.5, 8.0), TOPICS)]
    assert replayer.wait(seconds=60.0)
    assert graph.host.now / 1e9 == pytest.approx(8.5, abs=0.05)  # settled
    assert [text for _, text in graph.log] == [
        'waiting: /odom has no subscribers; /tire_samples has no subscribers',
        'waiting: /tire_samples has no subscribers']
    assert [when for when, _ in graph.log] == pytest.approx([2.0, 7.0], abs=0.05)
    times = [when for when, _ in graph.announced]
    assert {*map(tuple, (topics for _, topics in graph.announced))} == {TOPICS}
    assert times[0] < 0.001 and max(b - a for a, b in zip(times, times[1:])) < 0.15
    assert len(times) < 90
    assert replayer.result.unsubscribed == []


def test_a_topic_without_subscribers_is_no_failure(rig):
    graph, replayer = rig()
    graph.matched['/odom'] = 1
    assert replayer.wait(seconds=3.0)
    assert graph.host.now / 1e9 == pytest.approx(3.0, abs=0.05)
    assert replayer.result.unsubscribed == ['/imu/data', '/tire_samples']


def test_an_awaited_node_must_subscribe_and_have_matched(rig):
    graph, replayer = rig(awaited=('test', '/slip'))
    graph.nodes = {'slip'}
    assert not replayer.wait(seconds=3.0)
    assert replayer.result.failures == [  # names are relative to the namespace of the replayer
        '/robot/test is not running',
        '/slip subscribes to none of /imu/data, /odom, /tire_samples']
    graph, replayer = rig(awaited=('/slip',))
    graph.readers['/odom'], graph.readers['/imu/data'] = ['slip'], ['slip', 'other']
    graph.matched['/imu/data'] = 1
    assert not replayer.wait(seconds=3.0)
    assert replayer.result.failures == ['/slip is not matched on /imu/data, /odom']
    graph.matched.update({'/imu/data': 1, '/odom': 1})
    assert replayer.wait(seconds=3.0)
    assert replayer.result.unsubscribed == ['/tire_samples']


def test_an_estimator_in_the_graph_must_answer_and_be_ready(rig):
    graph, replayer = rig()
    graph.matched.update(TOPICS)
    graph.able, graph.readers['/odom'] = {'/slip'}, ['slip']
    assert not replayer.wait(seconds=1.0)
    assert replayer.result.failures == ['/slip does not answer']
    graph.followers, graph.not_ready = ['/slip'], {'/slip': 'has not heard from /friction'}
    assert not replayer.wait(seconds=1.0)
    assert replayer.result.failures == ['/slip has not heard from /friction']
    graph.not_ready = {}
    assert replayer.wait(seconds=1.0)
    assert replayer.result.followers == ['/slip'] and replayer.result.failures == []


def test_a_stop_while_waiting_is_no_failure(rig):
    stop = threading.Event()
    stop.set()
    _, replayer = rig(stop=stop, awaited=('/slip',))
    assert not replayer.wait(seconds=3.0)
    assert replayer.result.failures == []
