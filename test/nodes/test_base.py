"""What nodes share, tried on small nodes in this process and on real ones."""

from __future__ import annotations

import pytest
from rosgraph_msgs.msg import Clock
from support.graph import node_arguments, Process

from smart_tire.nodes.compat import message_class, plain
from smart_tire.nodes.diagnostics import InputCounter, Status

pytestmark = pytest.mark.processes


OLD_DISTRIBUTION = """
import sys

sys.modules['rclpy.experimental'] = None
from smart_tire.nodes import motor_driver

sys.exit(motor_driver.main())
"""


def test_a_distribution_without_the_events_executor_does_as_well(graph, tmp_path):
    with Process(['-c', OLD_DISTRIBUTION], tmp_path / 'log') as node:
        graph.until(lambda: 'motor_driver' in graph.health)
        assert not graph.call('std_srvs/srv/SetBool', 'emergency_stop', data=True).success
        graph.until(lambda: 'emergency stop' in graph.complaint('motor_driver'))
        assert node.end() == 0
        assert 'Traceback' not in node.output


def test_types_are_found_by_their_names():
    assert message_class('sensor_msgs/msg/JointState').__name__ == 'JointState'
    assert message_class('std_srvs/srv/Trigger').__name__ == 'Trigger'


def test_what_rcl_says_is_cut_to_what_a_user_can_use():
    error = RuntimeError("failed to initialize rcl: Couldn't parse params file: '--params-file "
                         "x.yaml'. Error: Error opening YAML file, at /project/src/parser.c:271, "
                         'at /project/src/rcl/arguments.c:415')
    assert plain(error) == ("Couldn't parse params file: '--params-file x.yaml'. "
                            'Error: Error opening YAML file')


def test_only_the_first_second_fourth_and_eighth_failure_are_worth_a_line():
    tally = InputCounter()
    assert [count for count in range(1, 20) if tally.fail()] == [1, 2, 4, 8, 16]
    assert (tally.newly_bad(), tally.newly_bad()) == (19, 0)


def test_ages_are_counted_from_the_last_good_one():
    tally = InputCounter()
    assert tally.age(5_000_000_000) == float('inf')
    tally.good(3_000_000_000)
    tally.fail()
    assert tally.age(5_000_000_000) == 2.0


def test_the_worst_complaint_gives_the_level_and_comes_first():
    status = Status()
    assert (status.message('x').level, status.message('x').message) == (b'\x00', 'ok')
    status.warn('slow')
    assert status.message('x').level == b'\x01'
    status.error('gone')
    status.values['age'] = 1.25
    message = status.message('x', '/dev/x')
    assert (message.level, message.message) == (b'\x02', 'gone; slow')
    assert [(item.key, item.value) for item in message.values] == [('age', '1.25')]
    assert message.hardware_id == '/dev/x'


def test_stamps_follow_simulated_time_while_the_loop_follows_the_real_one(graph):
    graph.listen('wheel_commands')
    clock = graph.node.create_publisher(Clock, '/clock', 10)

    def tick():
        message = Clock()
        message.clock.sec = 100
        clock.publish(message)

    with graph.start('wheel_controller', use_sim_time='true') as node:
        graph.until(lambda: [sample.stamp_ns for sample in graph.samples('wheel_commands')[-5:]]
                    == [100_000_000_000] * 5, tick)  # the clock stands, the loop does not
        assert node.end() == 0


def test_names_can_be_put_into_a_namespace(graph, tmp_path):
    heard = []
    graph.node.create_subscription(
        message_class('sensor_msgs/msg/JointState'), 'robot/wheel_commands', heard.append, 10)
    with Process([*node_arguments('wheel_controller'), '-r', '__ns:=/robot'],
                 tmp_path / 'log') as node:
        graph.until(lambda: heard and 'robot/wheel_controller' in graph.health)
        assert node.end() == 0


DEFECT = """
import sys, threading
from smart_tire.nodes.base import run, SmartTireNode
from smart_tire.parameters import WheelControllerParams


class Defective(SmartTireNode):
    def __init__(self):
        super().__init__('defective', WheelControllerParams)

    def start(self):
        threading.Thread(target=lambda: 1 / 0).start()


sys.exit(run(Defective))
"""


def test_a_thread_that_dies_of_a_defect_takes_the_node_with_it(graph, tmp_path):
    with Process(['-c', DEFECT], tmp_path / 'log') as node:
        assert node.ended() == 1
        assert 'ZeroDivisionError' in node.output
