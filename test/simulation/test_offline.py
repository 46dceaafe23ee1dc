# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Offline simulation: rates, times, losses, and consistency of the topics."""

from collections import Counter

import numpy as np
import pytest
from smart_tire.models.vehicle import skid_steer
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import NS_PER_S, WHEELS
from smart_tire.simulation.offline import EPOCH_NS, simulate

CONCRETE = {'ground.base': 'concrete', 'film.wheels': ['front_left', 'front_right']}
SCHEDULE = [(0.5, 120, 60), (4.0, 60, 120)]


@pytest.fixture(scope='module')
def events():
    return simulate(build(SimulatorParams, CONCRETE), SCHEDULE, 8.0)


def of(events, topic):
    return [sample for _, name, sample in events if name == topic]


def test_every_topic_has_its_rate(events):
    counts = Counter(topic for _, topic, _ in events)
    assert counts['imu/data'] == counts['ground_truth/odom'] == 800
    assert counts['ground_truth/wheel_slip'] == 800
    assert counts['wheel_states'] in (126, 127, 128)
    assert 0.95 * 6400 < counts['tire_samples'] <= 6400
    assert counts['ground_truth/tire_friction'] > 15


def test_events_are_in_order_of_reception_and_not_before_their_timestamps(events):
    received = [receive_ns for receive_ns, _, _ in events]
    assert received == sorted(received)
    assert all(receive_ns >= sample.stamp_ns - 5_000_000 for receive_ns, _, sample in events)
    assert min(sample.stamp_ns for _, _, sample in events) >= EPOCH_NS


def test_delays_of_batches_are_bounded(events):
    late = [receive_ns - sample.stamp_ns for receive_ns, topic, sample in events
            if topic == 'tire_samples']
    assert np.quantile(late, 0.95) > 40_000_000 and max(late) < 60_000_000


def test_events_depend_on_the_seed_only():
    one, again, other = (simulate(build(SimulatorParams, {**CONCRETE, 'seed': seed}), SCHEDULE,
                                  1.0) for seed in (1, 1, 2))
    assert repr(again) == repr(one)  # repr, because NaN is not equal to NaN
    for topic in ('imu/data', 'tire_samples', 'wheel_states'):
        assert of(other, topic) != of(one, topic)


def test_only_lost_batches_leave_gaps():
    def gaps(loss):
        run = simulate(build(SimulatorParams, {**CONCRETE, 'radio.loss': loss}), SCHEDULE, 3.0)
        stamps = np.array([s.stamp_ns for s in of(run, 'tire_samples') if s.wheel == 'front_left'])
        return int(np.sum(np.diff(stamps) > 10_000_000))
    assert gaps(0.0) == 0 and gaps(0.3) > 5


def test_wheel_speeds_follow_the_schedule(events):
    speeds = {sample.stamp_ns: sample.velocity for sample in of(events, 'wheel_states')}
    rpm = np.array([speeds[stamp] for stamp in sorted(speeds)
                    if 2 < (stamp - EPOCH_NS) / NS_PER_S < 4]) * 60.0 / (2.0 * np.pi)
    np.testing.assert_allclose(rpm.mean(axis=0), [120, 60, 120, 60], rtol=0.01)


@pytest.mark.parametrize('inertia', [0.008, 0.004])
def test_sliding_wheels_follow_the_schedule_without_oscillation(inertia):
    params = build(SimulatorParams, {
        'motor.inertia': inertia, 'ground.base': 'concrete', 'ground.names': ['concrete'],
        'ground.friction': [0.02], 'ground.stiffness': [52.7], 'ground.drag': [0.0],
        'ground.patches.names': []})
    speeds = np.array([sample.velocity for sample in of(
        simulate(params, [(0.5, 120, 60)], 3.0), 'wheel_states')
        if sample.stamp_ns > EPOCH_NS + 2 * NS_PER_S])
    np.testing.assert_allclose(speeds, np.broadcast_to([4 * np.pi, 2 * np.pi] * 2, speeds.shape),
                               atol=1.0)  # jitter of the stamps: .6 rad/s


def test_mean_speed_and_position_of_wheels_agree(events):
    states = of(events, 'wheel_states')
    for before, after in zip(states, states[1:]):
        dt = (after.stamp_ns - before.stamp_ns) / NS_PER_S
        rotation = np.subtract(after.position, before.position)
        np.testing.assert_allclose(rotation / dt, after.velocity, rtol=1e-9)


def test_the_true_slip_agrees_with_the_true_motion(events):
    params = SimulatorParams().robot
    for odometry, slip in zip(of(events, 'ground_truth/odom'),
                              of(events, 'ground_truth/wheel_slip')):
        assert odometry.stamp_ns == slip.stamp_ns
        v_x, _ = skid_steer.wheel_velocities(
            odometry.linear[0], odometry.linear[1], odometry.angular[2], params.wheelbase,
            params.track_width)
        ratio = skid_steer.slip_ratio(np.array(slip.slip_velocity) + v_x, v_x,
                                      params.slip.standstill_speed)
        np.testing.assert_allclose(slip.ratio, ratio, atol=1e-9)
        assert slip.sigma == tuple(1.0 if np.isnan(value) else 0.0 for value in ratio)


def test_crossings_have_the_slip_of_their_wheel_at_their_time(events):
    slips = of(events, 'ground_truth/wheel_slip')
    crossings = of(events, 'ground_truth/tire_friction')
    assert {crossing.wheel for crossing in crossings} == {'front_left', 'front_right'}
    steady = 0
    for crossing in crossings:
        near = [slip.ratio[WHEELS.index(crossing.wheel)] for slip in slips
                if abs(slip.stamp_ns - crossing.stamp_ns) < 100_000_000]
        if max(near) - min(near) < 0.01:
            steady += 1
            assert min(near) - 1e-3 < crossing.slip.value < max(near) + 1e-3
    assert steady > 8


def test_odometry_starts_at_zero_at_any_start_pose():
    start = [5.0, -2.0, 2.5]
    params = build(SimulatorParams, {'ground.base': 'concrete', 'ground.patches.names': [],
                                     'film.wheels': [], 'start': start,
                                     'errors.motor_friction': 0.0})  # equal motors: straight
    run = simulate(params, [(0.0, 60, 60)], 2.0)
    last = of(run, 'ground_truth/odom')[-1]
    assert last.position[0] > 0.5 and last.position[1] == pytest.approx(0.0, abs=1e-6)
    assert last.orientation == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-6)


@pytest.mark.parametrize('rate', [4.0, 200.0])
def test_any_wheel_rate_works_and_the_schedule_may_be_a_function(rate):
    run = simulate(build(SimulatorParams, {'film.wheels': []}),
                   lambda time: (60.0 * time, 30.0), 2.0, wheel_rate=rate)
    states = of(run, 'wheel_states')
    assert len(states) == pytest.approx(2.0 * rate, abs=2)
    assert all(now.stamp_ns > before.stamp_ns for before, now in zip(states, states[1:]))
    assert states[-1].velocity[0] > 1.5 * states[-1].velocity[1]
