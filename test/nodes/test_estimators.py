"""The estimator nodes as processes: messages in, messages out, bad ones counted."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest
from sensor_msgs.msg import JointState

from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, ImuSample, NS_PER_S, TireSample, WheelSample)
from smart_tire.uncertain import Uncertain

pytestmark = pytest.mark.processes

START_NS = 1_700_000_000 * NS_PER_S
REST = (0.0, 0.0, 9.81)
GRID_NS = 8_000_000


def standing(graph, seconds=1.0, start_ns=START_NS, wheel_speed=0.0):
    """Publish what a robot feels that stands for some seconds, its wheels spinning or not."""
    for tick in range(1, round(100 * seconds)):
        stamp_ns = start_ns + tick * 10_000_000
        graph.say('imu/data', ImuSample(stamp_ns, REST, (0.0, 0.0, 0.0)))
        if tick % 5 == 0:
            angle = wheel_speed * tick * 0.01
            graph.say('wheel_states', WheelSample(stamp_ns, (wheel_speed,) * 4, (angle,) * 4))
        if tick % 2 == 0:
            graph.turn()  # about the pace of a robot


def connect(graph, node, **samples):
    """Repeat ``samples`` until ``node`` says that each has come: then nothing gets lost."""
    def heard(name):
        return graph.value(node, f'{name}.last_message_age') not in ('', 'inf')

    def say():
        for name, sample in samples.items():
            graph.say(name.replace('__', '/'), sample)

    graph.until(lambda: all(heard(name.replace('__', '/')) for name in samples), say)


@pytest.fixture
def slip(graph):
    graph.listen('odom', 'wheel_slip', 'icr')
    with graph.start('slip_estimator') as node:
        connect(graph, 'slip_estimator', wheel_states=WheelSample(START_NS, (0.0,) * 4),
                imu__data=ImuSample(START_NS, REST, (0.0, 0.0, 0.0)))
        yield node
        assert node.end() == 0
        assert 'Traceback' not in node.output


def test_every_grid_instant_gets_odometry_and_slip(graph, slip):
    standing(graph)
    graph.until(lambda: len(graph.heard['odom']) >= 115
                and len(graph.heard['wheel_slip']) >= 115)
    for name in ('odom', 'wheel_slip'):
        stamps = [sample.stamp_ns for sample in graph.samples(name)]
        assert {stamp % GRID_NS for stamp in stamps} == {0}
        assert {b - a for a, b in zip(stamps, stamps[1:])} == {GRID_NS}
    message = graph.heard['odom'][-1]
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')
    assert all(math.isnan(ratio) for ratio in graph.samples('wheel_slip')[-1].ratio)
    assert not graph.heard['icr']


def test_the_origin_of_odom_is_moved_to_the_robot_on_request(graph, slip):
    standing(graph)
    graph.until(lambda: graph.heard['odom'])
    assert graph.call('std_srvs/srv/Trigger', 'reset_odometry').success
    seen = len(graph.heard['odom'])
    standing(graph, 0.3, START_NS + NS_PER_S)
    graph.until(lambda: len(graph.heard['odom']) > seen + 20)
    assert graph.samples('odom')[-1].position == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_what_is_late_or_no_number_is_counted_and_the_rest_goes_on(graph, slip):
    standing(graph)
    graph.until(lambda: len(graph.heard['odom']) > 110)
    graph.say('imu/data', ImuSample(START_NS + 500_000_000, REST, (0.0, 0.0, 0.0)),
              ImuSample(START_NS + NS_PER_S, (math.nan, 0.0, 9.81), (0.0, 0.0, 0.0)))
    graph.say_message('wheel_states', JointState(name=['front_left'], velocity=[0.0]))
    graph.until(lambda: graph.value('slip_estimator', 'frames_bad') == '2')
    assert graph.value('slip_estimator', 'late_messages') == '1'
    assert 'imu/data: linear_acceleration is [nan' in slip.output
    assert 'expected each of front_left, front_right' in slip.output
    seen = len(graph.heard['odom'])
    standing(graph, 0.5, START_NS + NS_PER_S)
    graph.until(lambda: len(graph.heard['odom']) > seen + 40)


def test_silent_inputs_are_named(graph, slip):
    graph.until(lambda: 'no imu/data; no wheel_states' in graph.complaint('slip_estimator'))


def test_passages_are_heard_where_films_aid_the_slip(graph):
    told = Friction(START_NS, 'front_right', film_slip=Uncertain(0.1, 0.01))
    graph.listen('odom')
    with graph.start('slip_estimator', slip__film_aided='true') as node:
        connect(graph, 'slip_estimator', wheel_states=WheelSample(START_NS, (0.0,) * 4),
                imu__data=ImuSample(START_NS, REST, (0.0, 0.0, 0.0)), tire_friction=told)
        standing(graph, 1.5, wheel_speed=6.0)
        graph.until(lambda: len(graph.heard['odom']) > 150)
        in_time, too_late = (replace(told, stamp_ns=START_NS + after * 1_000_000)
                             for after in (1300, 200))
        graph.say('tire_friction', too_late)
        graph.say('tire_friction', in_time)
        graph.until(lambda: graph.value('slip_estimator', 'tire_friction.late_messages') == '1')
        standing(graph, 1.5, START_NS + 3 * NS_PER_S // 2, 6.0)
        graph.until(lambda: graph.value('slip_estimator', 'films_used') == '1')
        assert node.end() == 0
        assert 'Traceback' not in node.output


def passage(time, wheel_speed=6.0, radius=0.087, peak=0.8):
    """Return the volts of a film whose wheel brings it through the patch at ``time`` 0."""
    place = wheel_speed * radius * time / 0.02
    return 1.65 + (peak if 0.0 < place < 2.3 else -peak * math.exp(2.3 - place)
                   if place >= 2.3 else 0.0)


def test_the_friction_estimator_takes_all_its_inputs_and_survives_bad_ones(graph):
    graph.listen('tire_friction')
    with graph.start('friction_estimator') as node:
        connect(graph, 'friction_estimator', wheel_states=WheelSample(START_NS, (6.0,) * 4),
                tire_samples=TireSample(START_NS, 'front_right', (1.65, 1.65)))
        before = int(graph.value('friction_estimator', 'frames_ok'))
        bad = JointState(name=['front_right_pvdf_1'], position=[math.nan])
        bad.header.frame_id = 'front_right'
        graph.say_message('tire_samples', bad)
        for tick in range(1, 1601):
            stamp_ns = START_NS + tick * 2_500_000
            turn = tick * 2.5e-3 % (2.0 * math.pi / 6.0)
            graph.say('tire_samples', TireSample(stamp_ns, 'front_right', (
                passage(turn - 0.2), passage(turn - 0.2 - 0.03 / (6.0 * 0.087)))))
            if tick % 25 == 0:
                angle = 6.0 * tick * 2.5e-3
                graph.say('wheel_states', WheelSample(stamp_ns, (6.0,) * 4, (angle,) * 4))
            if tick % 8 == 0:
                graph.turn()  # about the pace of a robot
        graph.until(lambda: int(graph.value('friction_estimator', 'frames_ok')) >= before + 1664
                    and graph.value('friction_estimator', 'frames_bad') == '1')
        assert 'position is [nan' in node.output
        graph.until(lambda: graph.heard['tire_friction'])
        assert node.end() == 0
        assert 'Traceback' not in node.output
    for message in graph.heard['tire_friction']:
        assert message.header.frame_id == 'front_right'
        assert tuple(message.name) == FRICTION_QUANTITIES
