"""Live, replayed at any rate, and offline: the same numbers."""

from __future__ import annotations

from collections import Counter
import math

import pytest

from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.bags import Bag, BagWriter
from smart_tire.bags.cdr import Decoder
from smart_tire.cli.stack import ESTIMATORS, isolated_environment, Stack
from smart_tire.messages import topic_of
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import Friction, Odometry, WheelSlip
from smart_tire.simulation.run import simulate
from support.stack import count, parameter_file
from support.waiting import wait_for

WHEELS = ['front_left', 'front_right']
INPUTS = ('imu/data', 'wheel_states', 'tire_samples')
OUTPUTS = ('odom', 'wheel_slip', 'icr', 'tire_friction')


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """Return the bag of a simulated turn and the parameter file of its robot."""
    folder = tmp_path_factory.mktemp('recording')
    params = build(SimulatorParams, {
        'seed': 5, 'film.wheels': WHEELS, 'ground.base': 'concrete', 'radio.loss': 0.02})
    with BagWriter(folder / 'bag') as writer:
        for receive_ns, topic, sample in simulate(params, [(1.5, 120.0, 60.0)], 7.0):
            if topic in INPUTS:
                writer.write_sample(topic, receive_ns, sample)
    return folder / 'bag', parameter_file(folder / 'robot.yaml', {'/**': {'film.wheels': WHEELS}})


def key(sample):
    return topic_of(sample), sample.stamp_ns, getattr(sample, 'wheel', '')


def numbers(sample):
    if isinstance(sample, Friction):
        return [*sample.value.values(), *sample.sigma.values()]
    if isinstance(sample, Odometry):
        return [*sample.position, *sample.orientation, *sample.linear, *sample.angular,
                *sample.pose_covariance, *sample.twist_covariance]
    if isinstance(sample, WheelSlip):
        return [*sample.ratio, *sample.sliding, *sample.sigma]
    return [sample.x, sample.y]


@pytest.fixture(scope='module')
def offline(recording):
    """Return the estimates of the cores alone, fed in the order of reception."""
    bag_path, params = recording
    pipeline = Pipeline(EstimatorParams.load([params]))
    with Bag(bag_path) as bag:
        found = {key(estimate): estimate for _, _, sample in bag.samples(INPUTS)
                 for estimate in pipeline.update(sample)}
    assert sum(isinstance(estimate, Friction) for estimate in found.values()) >= 10
    return found


@pytest.mark.parametrize('rate', [1.0, 5.0])
def test_nodes_on_a_replayed_bag_give_the_numbers_of_the_offline_run(
        recording, offline, tmp_path, rate):
    bag_path, params = recording
    out = tmp_path / 'estimates'
    with Stack(tmp_path / 'logs', isolated_environment()) as stack:
        stack.start('recorder', 'smart_tire.cli.main', 'record', '--out', str(out), '--topics',
                    *OUTPUTS, '/diagnostics')
        for node in ESTIMATORS:
            stack.node(node, [params])
        wait_for(lambda: all(f'recording /{topic}' in stack.log('recorder') for topic in OUTPUTS))
        stack.start('replay', 'smart_tire.cli.main', 'replay', str(bag_path), '--rate', str(rate),
                    '--wait', '20')
        stack.processes['replay'].wait(60.0)
        assert stack.stop('replay') == {'replay': 0}, stack.log('replay')
        last = max(stamp for topic, stamp, _ in offline if topic == 'odom')
        first = min(stamp for topic, stamp, _ in offline if topic == 'odom')
        whole = (last - first) // 8_000_000 + 1
        wait_for(lambda: count(out, 'odom') >= whole - 5)
        reports = count(out, 'diagnostics') + 2 * len(ESTIMATORS)  # of all that came too late
        wait_for(lambda: count(out, 'diagnostics') >= reports)
        stack.stop()
    late = late_messages(out)
    compared = Counter()
    with Bag(out) as bag:
        for _, topic, live in bag.samples(OUTPUTS):
            node = 'friction_estimator' if topic == 'tire_friction' else 'slip_estimator'
            if late[node] and key(live) not in offline:
                continue
            compare(live, offline[key(live)], exact=not late[node])
            compared[topic] += 1
    for topic in OUTPUTS if not late else ('odom', 'wheel_slip'):
        assert compared[topic] > 0.8 * sum(name == topic for name, _, _ in offline), compared


def late_messages(bag_path):
    """Return node -> messages that it had to drop because they came too late."""
    late, read = Counter(), Decoder('diagnostic_msgs/msg/DiagnosticArray')
    with Bag(bag_path) as bag:
        for _, _, data in bag.raw(['/diagnostics']):
            for status in read(data).status:
                values = {item.key: item.value for item in status.values}
                late[status.name] = int(values.get('late_messages', 0))
    return +late


def compare(live, offline, exact):
    """Check that two estimates are the same; after late messages, within one sigma."""
    sigmas = map(max, one_sigma(live), one_sigma(offline))
    for own, other, sigma in zip(numbers(live), numbers(offline), sigmas):
        same = own == other or math.isnan(own) and math.isnan(other)
        if not same and (exact or math.isfinite(sigma)):  # what knows nothing can not contradict
            limit = 1e-9 * max(1.0, abs(other)) if exact else sigma
            assert abs(own - other) <= limit, (live, offline)


def one_sigma(sample):
    """Return the sigmas that belong to ``numbers``; infinite where there is none."""
    if isinstance(sample, Friction):
        return [*sample.sigma.values(), *[math.inf] * len(sample.sigma)]
    if isinstance(sample, WheelSlip):
        return [*sample.sigma, *[math.inf] * 8]
    if isinstance(sample, Odometry):
        position = [math.sqrt(sample.pose_covariance[7 * row]) for row in range(3)]
        return [*position, *[math.inf] * 82]
    return [math.inf] * 2
