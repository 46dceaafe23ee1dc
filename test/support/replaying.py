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
import math
from pathlib import Path
import time
from typing import Any

from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, Pipeline
from smart_tire.bags import Bag
from smart_tire.bags.cdr import Decoder
from smart_tire.cli._stack import ESTIMATORS, isolated_environment, params_arguments, Stack
from smart_tire.messages import topic_of, TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, GROUND_ESTIMATES, GroundState, Odometry, WheelSlip)
from support.graph import Graph, node_arguments, Process
from support.stack import count
from support.waiting import PATIENCE, wait_for

START_DELAY_NS = 200_000_000  # ns before the first message
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


def replayed(bag_path: Path, params: Path, folder: Path, rate: float, expected: dict[Any, Any],
             composed: bool = False) -> tuple[dict[Any, Any], Counter[str]]:
    """
    Return the estimates of the nodes on a replay, and node -> number of late messages.

    ``expected`` are the estimates to wait for. The estimators, in one process if ``composed``,
    start after the replayer and a recorder of all topics, including the inputs. The replay waits
    for another node, ``last``, which starts when the estimates are recorded.
    """
    out = folder / 'estimates'
    with Stack(folder / 'logs', isolated_environment()) as stack:
        stack.start('other', 'smart_tire.cli.main', 'record', '--out', str(folder / 'all'))
        stack.start('recorder', 'smart_tire.cli.main', 'record', '--out', str(out), '--topics',
                    *ESTIMATES, '/diagnostics')
        stack.start('replay', 'smart_tire.cli.main', 'replay', str(bag_path), '--rate', str(rate),
                    '--wait', str(PATIENCE), '--wait-for', *ESTIMATORS, 'last')
        wait_for(lambda: all(f'recording /{topic}' in stack.log('other') for topic in INPUTS))
        if composed:
            stack.start('composed', 'smart_tire.nodes.composed', *ESTIMATORS,
                        *params_arguments([params]))
        for node in () if composed else ESTIMATORS:
            stack.node(node, [params])
        wait_for(lambda: all(f'recording /{topic}' in stack.log('recorder')
                             for topic in ESTIMATES))
        stack.start('last', 'smart_tire.cli.main', 'record', '--out', str(folder / 'last'),
                    '--topics', 'imu/data', '--ros-args', '-r', '__node:=last')
        stack.processes['replay'].wait(PATIENCE)
        assert stack.stop('replay') == {'replay': 0}, stack.log('replay')
        wanted = Counter(topic for topic, _, _ in expected)
        wait_for(lambda: all(count(out, topic) >= wanted[topic] for topic in ESTIMATES))
        reports = count(out, 'diagnostics') + 2 * len(ESTIMATORS)  # final counts
        wait_for(lambda: count(out, 'diagnostics') >= reports)
        stack.stop()
    with Bag(out) as bag:
        return {key(live): live for _, _, live in bag.samples(ESTIMATES)}, late_messages(out)


def late_messages(bag_path: Path) -> Counter[str]:
    """Return node -> number of messages that it dropped because they were late."""
    late: Counter[str] = Counter()
    read = Decoder('diagnostic_msgs/msg/DiagnosticArray')
    with Bag(bag_path) as bag:
        for _, _, data in bag.raw(['/diagnostics']):
            for status in read(data).status:
                values = {item.key: item.value for item in status.values}
                late[status.name] = int(values.get('late_messages', 0))
    return +late


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

    They are published at the recorded rate; DDS and the executors determine their order.
    """
    found: dict[Any, Any] = {}
    with ExitStack() as stack:
        graph = stack.enter_context(Graph(folder))
        for node in ESTIMATORS:
            stack.enter_context(Process([*node_arguments(node), '--params-file', str(params)],
                                        folder / f'{node}.log'))
        graph.subscribe(*ESTIMATES)
        graph.until(lambda: graph.has_publishers() and set(ESTIMATORS) <= graph.health.keys())
        for topic, readers in (('imu/data', 2), ('wheel_states', 2), ('tire_samples', 1)):
            graph.connect(topic, message_class(TOPICS[topic].type), readers)
        with Bag(bag_path) as bag:
            messages = list(bag.samples(INPUTS))
        begin, first = time.monotonic_ns() + START_DELAY_NS, messages[0][0]
        for receive_ns, topic, sample in messages:
            while time.monotonic_ns() - begin < receive_ns - first:
                graph.spin(0.001)
            graph.publish(topic, sample)
        newest = max(stamp for _, stamp, _ in offline_estimates(bag_path, params))
        graph.until(lambda: any(sample.stamp_ns >= newest - END_TOLERANCE_NS
                                for sample in graph.samples('odom')[-5:]))
        settled = time.monotonic() + 1.0
        graph.until(lambda: time.monotonic() > settled)
        for topic in ESTIMATES:
            found.update((key(sample), sample) for sample in graph.samples(topic))
    return found


def same_crossing(found: dict[Any, Any], friction: Any) -> Any:
    """Return the estimate in ``found`` of a crossing; late messages may shift its timestamp."""
    same = [other for other in found.values() if isinstance(other, Friction)
            and isinstance(friction, Friction) and other.wheel == friction.wheel
            and abs(other.stamp_ns - friction.stamp_ns) < END_TOLERANCE_NS]
    return same[0] if same else None


def normalized_errors(found: dict[Any, Any], expected: dict[Any, Any]) -> dict[str, list[float]]:
    """Return topic -> differences of its main quantities over their standard deviations."""
    errors: dict[str, list[float]] = {'odom': [], 'wheel_slip': [], 'tire_friction': []}
    for name, other in expected.items():
        live = found.get(name) or same_crossing(found, other)
        if live is None:
            continue
        pairs: list[tuple[float, float, float]] = []
        if isinstance(other, Odometry):
            pairs = [(live.linear[0], other.linear[0], math.sqrt(other.twist_covariance[0])),
                     (live.position[0], other.position[0], math.sqrt(other.pose_covariance[0])),
                     (live.position[1], other.position[1], math.sqrt(other.pose_covariance[7]))]
        elif isinstance(other, WheelSlip):
            pairs = list(zip(live.ratio, other.ratio, other.sigma))
        elif isinstance(other, Friction):
            pairs = [(live.friction_coefficient.value, *other.friction_coefficient)]
        errors.get(name[0], []).extend(
            abs(a - b) / sigma for a, b, sigma in pairs
            if math.isfinite(a) and math.isfinite(b) and sigma > 0.0)
    return errors
