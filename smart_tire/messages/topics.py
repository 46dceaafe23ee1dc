"""The topics of the contract: what each carries, how, how often and where from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from smart_tire.messages.joint_state import (
    decode_friction, decode_motor_command, decode_tire, decode_wheel_command, decode_wheel_slip,
    decode_wheels, fill_friction, fill_motor_command, fill_tire, fill_wheel_command,
    fill_wheel_slip, fill_wheels)
from smart_tire.messages.odometry_imu import (
    decode_battery, decode_icr, decode_imu, decode_odometry, decode_velocity, fill_battery,
    fill_icr, fill_imu, fill_odometry, fill_velocity)
from smart_tire.samples import (
    BatterySample, Friction, Icr, ImuSample, MotorCommand, Odometry, Sample, TireSample,
    VelocityCommand, WheelCommand, WheelSample, WheelSlip)


SampleClass = type[Any]


@dataclass(frozen=True)
class Topic:
    """One topic of the contract: what it carries, how, how often and where from."""

    name: str
    type: str                         # of the messages, such as 'sensor_msgs/msg/Imu'
    sample: SampleClass
    decode: Callable[[Any], Sample]   # message -> sample, or MessageError
    fill: Callable[[Any, Any], Any]   # empty message, sample -> message
    rate: float                       # Hz, nominal (tire: per wheel); 0: whenever there is one
    frame: str                        # header.frame_id; '' where it names the wheel
    quality: str                      # 'sensor', 'estimate', 'command' or 'truth'


JOINTS = 'sensor_msgs/msg/JointState'
ODOMETRY = 'nav_msgs/msg/Odometry'
# Rates are those of the table of topics; a wheel passes its patch twice a second at 120 rpm.
TOPICS: dict[str, Topic] = {topic.name: topic for topic in (
    Topic('imu/data', 'sensor_msgs/msg/Imu', ImuSample, decode_imu, fill_imu,
          100.0, 'imu_link', 'sensor'),
    Topic('wheel_states', JOINTS, WheelSample, decode_wheels, fill_wheels,
          16.0, 'base_link', 'sensor'),
    Topic('tire_samples', JOINTS, TireSample, decode_tire, fill_tire, 400.0, '', 'sensor'),
    Topic('tire_battery', 'sensor_msgs/msg/BatteryState', BatterySample,
          decode_battery, fill_battery, 1.0, '', 'sensor'),
    Topic('odom', ODOMETRY, Odometry, decode_odometry, fill_odometry, 125.0, 'odom', 'estimate'),
    Topic('wheel_slip', JOINTS, WheelSlip, decode_wheel_slip, fill_wheel_slip,
          125.0, 'base_link', 'estimate'),
    Topic('icr', 'geometry_msgs/msg/PointStamped', Icr, decode_icr, fill_icr,
          125.0, 'base_link', 'estimate'),
    Topic('tire_friction', JOINTS, Friction, decode_friction, fill_friction, 2.0, '', 'estimate'),
    Topic('cmd_vel', 'geometry_msgs/msg/TwistStamped', VelocityCommand,
          decode_velocity, fill_velocity, 0.0, 'base_link', 'command'),
    Topic('wheel_commands', JOINTS, WheelCommand, decode_wheel_command, fill_wheel_command,
          16.0, 'base_link', 'command'),
    Topic('motor_commands', JOINTS, MotorCommand, decode_motor_command, fill_motor_command,
          16.0, 'base_link', 'command'),
    Topic('ground_truth/odom', ODOMETRY, Odometry, partial(
        decode_odometry, topic='ground_truth/odom'), fill_odometry, 100.0, 'odom', 'truth'),
    Topic('ground_truth/wheel_slip', JOINTS, WheelSlip, partial(
        decode_wheel_slip, topic='ground_truth/wheel_slip'), fill_wheel_slip,
        100.0, 'base_link', 'truth'),
    Topic('ground_truth/tire_friction', JOINTS, Friction, partial(
        decode_friction, topic='ground_truth/tire_friction'), fill_friction, 2.0, '', 'truth'),
    Topic('overhead/odom', ODOMETRY, Odometry, partial(
        decode_odometry, topic='overhead/odom'), partial(fill_odometry, frame='map'),
        30.0, 'map', 'truth'),
    Topic('overhead/wheel_slip', JOINTS, WheelSlip, partial(
        decode_wheel_slip, topic='overhead/wheel_slip'), fill_wheel_slip,
        30.0, 'base_link', 'truth'),
)}
_NAME_OF = {topic.sample: topic.name for topic in reversed(TOPICS.values())}


def topic_of(sample: Sample) -> str:
    """Return the name of the topic that ``sample`` travels on."""
    return _NAME_OF[type(sample)]


def find_topic(name: str) -> Topic | None:
    """Return the contract's topic that ``name`` ends in, whatever its namespace; None if none."""
    parts = name.strip('/').split('/')
    for start in range(len(parts)):  # the longest ending first: ground_truth/odom is not odom
        if (topic := TOPICS.get('/'.join(parts[start:]))) is not None:
            return topic
    return None
