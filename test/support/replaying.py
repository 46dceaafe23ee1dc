# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimates of bags: replayed to estimator nodes, published live, and offline."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from itertools import groupby
import math
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import ListParameters
from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, Pipeline
from smart_tire.bags import Bag
from smart_tire.bags.cdr import Decoder
from smart_tire.cli._stack import ESTIMATORS, params_arguments
from smart_tire.messages import stamp_in, topic_of, TOPICS
from smart_tire.nodes.command_line import COMPOSED
from smart_tire.nodes.compat import message_class
from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, GROUND_ESTIMATES, GroundState, Odometry, WheelSlip)
from support.command import command
from support.graph import Graph, node_arguments, Process
from support.waiting import PATIENCE

DEPTH = 10_000  # messages, more than there are
MAX_REPORTS = 5  # of each node, one a second
STEP_NS = 20_000_000  # ns of the recording in which messages may overtake each other
END_TOLERANCE_NS = 100_000_000  # ns at the end in which estimates may be missing


def key(estimate) -> tuple[str, int, str]:
    """Return what identifies an estimate within a recording."""
    return topic_of(estimate), estimate.stamp_ns, getattr(estimate, 'wheel', '')


def numbers(estimate) -> list[float]:
    """Return all numbers of an estimate."""
    if isinstance(estimate, Friction):
        return [number for name in FRICTION_QUANTITIES for number in estimate.quantity(name)]
    if isinstance(estimate, Odometry):
        return [*estimate.position, *estimate.orientation, *estimate.linear, *estimate.angular,
                *estimate.pose_covariance, *estimate.twist_covariance]
    if isinstance(estimate, WheelSlip):
        return [*estimate.ratio, *estimate.slip_velocity, *estimate.sigma]
    if isinstance(estimate, GroundState):
        return [*(number for name in GROUND_ESTIMATES for number in getattr(estimate, name)),
                estimate.stiffness_friction_correlation]
    return [estimate.x, estimate.y]


def offline_estimates(bag_path: Path, params: Path) -> dict[Any, Any]:
    """Return the estimates of the offline analysis, in order of reception."""
    pipeline = Pipeline(EstimatorParams.load([params]))
    with Bag(bag_path) as bag:
        found = [estimate for _, _, sample in bag.samples(INPUTS)
                 for estimate in pipeline.update(sample)]
    return {key(estimate): estimate for estimate in [*found, *pipeline.finish()]}


class Listener:
    """A node of the test that receives all estimates, and the diagnostics of the estimators."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self._clients = [graph.node.create_client(ListParameters, f'{node}/list_parameters')
                         for node in ESTIMATORS]
        for topic in ESTIMATES:
            graph.node.create_subscription(message_class(TOPICS[topic].type), topic,
                                           graph.received[topic].append, DEPTH, raw=True)

    def until_known(self) -> None:
        """Return when the estimators have discovered the subscriptions made until now."""
        seen: set[str] = set()
        latest = self.graph.node.create_subscription(  # discovered in the order of creation
            DiagnosticArray, '/diagnostics',
            lambda array: seen.update(status.name for status in array.status), 100)
        self.graph.until(lambda: set(ESTIMATORS) <= seen)
        self.graph.node.destroy_subscription(latest)

    def until_handled(self) -> None:
        """Return when each estimator has answered a call, after what was published before."""
        for client in self._clients:
            self.graph.until(client.service_is_ready)
            self.graph.until(client.call_async(ListParameters.Request()).done)

    def until_reported(self) -> None:
        """Return when each estimator has counted what it has received until now."""
        for _ in range(2):  # the first report may have been on its way
            self.graph.health.clear()
            self.graph.until(lambda: set(ESTIMATORS) <= self.graph.health.keys())

    def estimates(self) -> dict[Any, Any]:
        """Return the estimates received."""
        found = {}
        for topic in ESTIMATES:
            read = Decoder(TOPICS[topic].type)
            for data in self.graph.received[topic]:
                sample = TOPICS[topic].from_msg(read(data))
                found[key(sample)] = sample
        return found

    def has(self, expected: dict[Any, Any]) -> bool:
        """Return whether as many estimates were received as ``expected``."""
        wanted = Counter(topic for topic, _, _ in expected)
        return all(len(self.graph.received[topic]) >= wanted[topic] for topic in ESTIMATES)

    def late(self) -> Counter[str]:
        """Return node -> number of messages that it dropped because they were late."""
        return +Counter({name: int(self.graph.value(name, 'late_messages'))
                         for name in ESTIMATORS})


def replayed(bag_path: Path, params: Path, folder: Path, rate: float, expected: dict[Any, Any],
             composed: bool = False) -> tuple[dict[Any, Any], Counter[str]]:
    """
    Return the estimates of the nodes on a replay, and node -> number of late messages.

    ``expected`` are the estimates to wait for. A host that is too slow for the ``rate`` loses some
    between the nodes and the test: then the replay is repeated at a fourth of the rate. The
    estimators run in one process if ``composed``.
    """
    listener = replay(bag_path, params, folder, rate, expected, composed)
    while not listener.has(expected) and rate > 1.0:
        rate /= 4.0
        listener = replay(bag_path, params, folder, rate, expected, composed)
    return listener.estimates(), listener.late()


def replay(bag_path: Path, params: Path, folder: Path, rate: float, expected: dict[Any, Any],
           composed: bool) -> Listener:
    """
    Replay a bag once; return what was received.

    The estimators start after the replayer. The replay waits for another node, ``test``, which
    starts when they are known.
    """
    processes = [(COMPOSED, *ESTIMATORS)] if composed else [(node,) for node in ESTIMATORS]
    with ExitStack() as stack, command(
            'replay', bag_path, '--rate', rate, '--wait', PATIENCE, '--wait-for', *ESTIMATORS,
            'test') as player:
        for module, *words in processes:
            stack.enter_context(Process(
                ['-m', f'smart_tire.nodes.{module}', *words, *params_arguments([params])],
                folder / f'{module}.log'))
        listener = Listener(stack.enter_context(Graph(folder)))
        listener.until_known()
        graph = listener.graph
        graph.node.create_subscription(
            message_class(TOPICS['imu/data'].type), 'imu/data', lambda message: None, 1)
        graph.until(lambda: not player.running)
        assert player.end() == 0, player.output
        for _ in range(MAX_REPORTS):  # of the nodes, after which nothing more is on its way
            listener.until_reported()
            if listener.has(expected):
                break
        return listener


def assert_same(found: dict[Any, Any], expected: dict[Any, Any]) -> None:
    """Check that the estimates are complete and equal to 1e-9."""
    assert found.keys() == expected.keys()
    for name, estimate in found.items():
        for own, other in zip(numbers(estimate), numbers(expected[name])):
            same = own == other or math.isnan(own) and math.isnan(other)
            assert same or abs(own - other) <= 1e-9 * max(1.0, abs(other)), (
                estimate, expected[name])


def played_live(bag_path: Path, params: Path, folder: Path) -> dict[Any, Any]:
    """
    Return the estimates of the nodes on messages published without lockstep.

    DDS and the executors determine the order of the messages that were received within
    ``STEP_NS``; then each node answers a call before more are published.
    """
    with ExitStack() as stack:
        graph = stack.enter_context(Graph(folder))
        listener = Listener(graph)
        for node in ESTIMATORS:
            stack.enter_context(Process([*node_arguments(node), '--params-file', str(params)],
                                        folder / f'{node}.log'))
        graph.until(lambda: graph.has_publishers() and set(ESTIMATORS) <= graph.health.keys())
        for topic, readers in (('imu/data', 2), ('wheel_states', 2), ('tire_samples', 1)):
            graph.connect(topic, message_class(TOPICS[topic].type), readers)
        with Bag(bag_path) as bag:
            messages = list(bag.samples(INPUTS))
        for _, step in groupby(messages, lambda message: message[0] // STEP_NS):
            for _, topic, sample in step:
                graph.publish(topic, sample)
            listener.until_handled()
        newest = max(stamp for _, stamp, _ in offline_estimates(bag_path, params))
        graph.until(lambda: any(stamp_in(data) >= newest - END_TOLERANCE_NS
                                for data in graph.received['odom'][-5:]))
        listener.until_reported()
        return listener.estimates()


def same_crossing(found: dict[Any, Any], friction: Any) -> Any:
    """Return the estimate in ``found`` of a crossing; late messages may shift its timestamp."""
    same = [other for other in found.values() if isinstance(other, Friction)
            and isinstance(friction, Friction) and other.wheel == friction.wheel
            and abs(other.stamp_ns - friction.stamp_ns) < END_TOLERANCE_NS]
    return same[0] if same else None


def normalized_errors(found: dict[Any, Any], expected: dict[Any, Any]) -> dict[str, list[float]]:
    """
    Return topic -> differences of its main quantities over their standard deviations.

    After other samples were lost, the estimates have errors of their own: the variance of their
    difference is at most the sum of theirs.
    """
    errors: dict[str, list[float]] = {'odom': [], 'wheel_slip': [], 'tire_friction': []}
    for name, other in expected.items():
        live = found.get(name) or same_crossing(found, other)
        if live is None:
            continue
        pairs = [(a, b, math.hypot(sigma, other_sigma)) for (a, sigma), (b, other_sigma) in zip(
            uncertain(live), uncertain(other))]
        errors.get(name[0], []).extend(
            abs(a - b) / sigma for a, b, sigma in pairs
            if math.isfinite(a) and math.isfinite(b) and sigma > 0.0)
    return errors


def uncertain(estimate: Any) -> list[tuple[float, float]]:
    """Return the main quantities of an estimate, each with its standard deviation."""
    if isinstance(estimate, Odometry):
        pose, twist = estimate.pose_covariance, estimate.twist_covariance
        return [(estimate.linear[0], math.sqrt(twist[0])),
                (estimate.position[0], math.sqrt(pose[0])),
                (estimate.position[1], math.sqrt(pose[7]))]
    if isinstance(estimate, WheelSlip):
        return list(zip(estimate.ratio, estimate.sigma))
    return [estimate.friction_coefficient] if isinstance(estimate, Friction) else []
