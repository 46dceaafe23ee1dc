"""Bags replayed to the estimators' processes, and the same bags offline."""

from __future__ import annotations

from collections import Counter
import math
from pathlib import Path
from typing import Any

from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, Pipeline
from smart_tire.bags import Bag
from smart_tire.bags.cdr import Decoder
from smart_tire.cli.stack import ESTIMATORS, isolated_environment, Stack
from smart_tire.messages import topic_of
from smart_tire.samples import Friction, Odometry, WheelSlip
from support.stack import count
from support.waiting import PATIENCE, wait_for


def key(estimate) -> tuple[str, int, str]:
    """Return what tells an estimate from others of the same run."""
    return topic_of(estimate), estimate.stamp_ns, getattr(estimate, 'wheel', '')


def numbers(estimate) -> list[float]:
    """Return all numbers of an estimate."""
    if isinstance(estimate, Friction):
        return [*estimate.value.values(), *estimate.sigma.values()]
    if isinstance(estimate, Odometry):
        return [*estimate.position, *estimate.orientation, *estimate.linear, *estimate.angular,
                *estimate.pose_covariance, *estimate.twist_covariance]
    if isinstance(estimate, WheelSlip):
        return [*estimate.ratio, *estimate.sliding, *estimate.sigma]
    return [estimate.x, estimate.y]


def offline_estimates(bag_path: Path, params: Path) -> dict[Any, Any]:
    """Return the estimates of the cores alone, fed in the order of reception."""
    pipeline = Pipeline(EstimatorParams.load([params]))
    with Bag(bag_path) as bag:
        return {key(estimate): estimate for _, _, sample in bag.samples(INPUTS)
                for estimate in pipeline.update(sample)}


def replayed(bag_path: Path, params: Path, folder: Path, rate: float,
             expected: dict[Any, Any]) -> tuple[dict[Any, Any], Counter[str]]:
    """
    Return the estimates of the nodes on a replay, and node -> messages that came too late.

    ``expected`` is how many there should be. The estimators start when the replayer and a recorder
    of all topics, the inputs too, are there. The replay waits for another node, ``last``, which
    starts when the estimates are recorded.
    """
    out = folder / 'estimates'
    with Stack(folder / 'logs', isolated_environment()) as stack:
        stack.start('other', 'smart_tire.cli.main', 'record', '--out', str(folder / 'all'))
        stack.start('recorder', 'smart_tire.cli.main', 'record', '--out', str(out), '--topics',
                    *ESTIMATES, '/diagnostics')
        stack.start('replay', 'smart_tire.cli.main', 'replay', str(bag_path), '--rate', str(rate),
                    '--wait', str(PATIENCE), '--wait-for', *ESTIMATORS, 'last')
        wait_for(lambda: all(f'recording /{topic}' in stack.log('other') for topic in INPUTS))
        for node in ESTIMATORS:
            stack.node(node, [params])
        wait_for(lambda: all(f'recording /{topic}' in stack.log('recorder')
                             for topic in ESTIMATES))
        stack.start('last', 'smart_tire.cli.main', 'record', '--out', str(folder / 'last'),
                    '--topics', 'imu/data', '--ros-args', '-r', '__node:=last')
        stack.processes['replay'].wait(PATIENCE)
        assert stack.stop('replay') == {'replay': 0}, stack.log('replay')
        wanted = Counter(topic for topic, _, _ in expected)
        wait_for(lambda: all(count(out, topic) >= wanted[topic] for topic in ESTIMATES))
        reports = count(out, 'diagnostics') + 2 * len(ESTIMATORS)  # of all that came too late
        wait_for(lambda: count(out, 'diagnostics') >= reports)
        stack.stop()
    with Bag(out) as bag:
        return {key(live): live for _, _, live in bag.samples(ESTIMATES)}, late_messages(out)


def late_messages(bag_path: Path) -> Counter[str]:
    """Return node -> messages that it had to drop because they came too late."""
    late: Counter[str] = Counter()
    read = Decoder('diagnostic_msgs/msg/DiagnosticArray')
    with Bag(bag_path) as bag:
        for _, _, data in bag.raw(['/diagnostics']):
            for status in read(data).status:
                values = {item.key: item.value for item in status.values}
                late[status.name] = int(values.get('late_messages', 0))
    return +late


def assert_same(found: dict[Any, Any], expected: dict[Any, Any]) -> None:
    """Check that all estimates are there and the same to 1e-9."""
    assert found.keys() == expected.keys()
    for name, estimate in found.items():
        for own, other in zip(numbers(estimate), numbers(expected[name])):
            same = own == other or math.isnan(own) and math.isnan(other)
            assert same or abs(own - other) <= 1e-9 * max(1.0, abs(other)), (
                estimate, expected[name])
