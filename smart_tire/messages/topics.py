# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Table of all topics: message type, sample class, conversions, rate and frame; docs/topics.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from smart_tire.messages.film import (
    charge_from_msg, charge_to_msg, deflection_from_msg, deflection_to_msg, FRAME,
    temperature_from_msg, temperature_to_msg)
from smart_tire.messages.grid import grid_from_msg, grid_to_msg
from smart_tire.messages.joint_state import (
    friction_from_msg, friction_to_msg, ground_state_from_msg, ground_state_to_msg,
    motor_command_from_msg, motor_command_to_msg, tire_from_msg, tire_to_msg,
    wheel_command_from_msg, wheel_command_to_msg, wheel_slip_from_msg, wheel_slip_to_msg,
    wheels_from_msg, wheels_to_msg)
from smart_tire.messages.odometry_imu import (
    battery_from_msg, battery_to_msg, icr_from_msg, icr_to_msg, imu_from_msg, imu_to_msg,
    odometry_from_msg, odometry_to_msg, velocity_from_msg, velocity_to_msg)
from smart_tire.messages.path import (
    goal_from_msg, goal_to_msg, path_from_msg, path_to_msg, progress_from_msg, progress_to_msg)
from smart_tire.messages.typed import (
    BATCH, BATCH_RATE, FORMS, samples_from_msg, samples_to_msg, SUFFIX)
from smart_tire.samples import (
    BatterySample, FilmCharge, FilmDeflection, FilmTemperature, Friction, FrictionGrid, GoalPose,
    GroundState, Icr, ImuSample, MotorCommand, Odometry, PathProgress, PlannedPath, Sample,
    TireSample, TireSamples, VelocityCommand, WheelCommand, WheelSample, WheelSlip)

SampleClass = type[Any]


@dataclass(frozen=True)
class Topic:
    """One topic: its type, sample class, conversions, rate and frame."""

    name: str
    type: str                         # such as 'sensor_msgs/msg/Imu'  # noqa: A003
    sample: SampleClass
    from_msg: Callable[[Any], Sample]     # message -> sample, or MessageError
    to_msg: Callable[[Any, Any], Any]     # message, sample -> message with the sample
    rate: float                       # Hz, nominal (tire: per wheel); 0: not periodic
    frame: str                        # header.frame_id; '' if it is the name of the wheel
    quality: str                      # 'sensor', 'estimate', 'command' or 'truth'

    @property
    def standard(self) -> str:
        """Return the name in ``TOPICS`` of the topic with the same samples."""
        return self.name.removesuffix(SUFFIX)


IMAGES = {  # topic -> type of images, which are no samples; the first that there is counts
    'overhead_camera/image_raw': 'sensor_msgs/msg/Image',
    'overhead_camera/image_raw/compressed': 'sensor_msgs/msg/CompressedImage'}
JOINTS = 'sensor_msgs/msg/JointState'
ODOMETRY = 'nav_msgs/msg/Odometry'
# Nominal rates as in docs/topics.md; tire_friction at 120 rpm, two revolutions per second.
TOPICS: dict[str, Topic] = {topic.name: topic for topic in (
    Topic('imu/data', 'sensor_msgs/msg/Imu', ImuSample, imu_from_msg, imu_to_msg,
          100.0, 'imu_link', 'sensor'),
    Topic('wheel_states', JOINTS, WheelSample, wheels_from_msg, wheels_to_msg,
          16.0, 'base_link', 'sensor'),
    Topic('tire_samples', JOINTS, TireSample, tire_from_msg, tire_to_msg, 400.0, '', 'sensor'),
    Topic('tire_battery', 'sensor_msgs/msg/BatteryState', BatterySample,
          battery_from_msg, battery_to_msg, 1.0, '', 'sensor'),
    Topic('film_charge', JOINTS, FilmCharge, charge_from_msg, charge_to_msg,
          500.0, FRAME, 'sensor'),
    Topic('film_temperature', 'sensor_msgs/msg/Temperature', FilmTemperature,
          temperature_from_msg, temperature_to_msg, 1.0, FRAME, 'sensor'),
    Topic('odom', ODOMETRY, Odometry, odometry_from_msg, odometry_to_msg,
          125.0, 'odom', 'estimate'),
    Topic('wheel_slip', JOINTS, WheelSlip, wheel_slip_from_msg, wheel_slip_to_msg,
          125.0, 'base_link', 'estimate'),
    Topic('icr', 'geometry_msgs/msg/PointStamped', Icr, icr_from_msg, icr_to_msg,
          125.0, 'base_link', 'estimate'),
    Topic('ground_state', JOINTS, GroundState, ground_state_from_msg, ground_state_to_msg,
          2.0, 'base_link', 'estimate'),
    Topic('tire_friction', JOINTS, Friction, friction_from_msg, friction_to_msg,
          2.0, '', 'estimate'),
    Topic('film_deflection', JOINTS, FilmDeflection, deflection_from_msg, deflection_to_msg,
          500.0, FRAME, 'estimate'),
    Topic('friction_map', 'nav_msgs/msg/OccupancyGrid', FrictionGrid, grid_from_msg, grid_to_msg,
          0.0, 'odom', 'estimate'),
    Topic('path', 'nav_msgs/msg/Path', PlannedPath, path_from_msg, path_to_msg,
          0.0, 'odom', 'command'),
    Topic('goal_pose', 'geometry_msgs/msg/PoseStamped', GoalPose, goal_from_msg, goal_to_msg,
          0.0, 'odom', 'command'),
    Topic('path_progress', JOINTS, PathProgress, progress_from_msg, progress_to_msg,
          4.0, 'odom', 'estimate'),
    Topic('cmd_vel', 'geometry_msgs/msg/TwistStamped', VelocityCommand,
          velocity_from_msg, velocity_to_msg, 0.0, 'base_link', 'command'),
    Topic('wheel_commands', JOINTS, WheelCommand, wheel_command_from_msg, wheel_command_to_msg,
          16.0, 'base_link', 'command'),
    Topic('motor_commands', JOINTS, MotorCommand, motor_command_from_msg, motor_command_to_msg,
          16.0, 'base_link', 'command'),
    Topic('ground_truth/odom', ODOMETRY, Odometry, partial(
        odometry_from_msg, topic='ground_truth/odom'), odometry_to_msg, 100.0, 'odom', 'truth'),
    Topic('ground_truth/wheel_slip', JOINTS, WheelSlip, partial(
        wheel_slip_from_msg, topic='ground_truth/wheel_slip'), wheel_slip_to_msg,
        100.0, 'base_link', 'truth'),
    Topic('ground_truth/tire_friction', JOINTS, Friction, partial(
        friction_from_msg, topic='ground_truth/tire_friction'), friction_to_msg, 2.0, '', 'truth'),
    Topic('ground_truth/film_deflection', JOINTS, FilmDeflection, partial(
        deflection_from_msg, topic='ground_truth/film_deflection'), deflection_to_msg,
        100.0, FRAME, 'truth'),
    Topic('overhead/odom', ODOMETRY, Odometry, partial(
        odometry_from_msg, topic='overhead/odom'), partial(odometry_to_msg, frame='map'),
        30.0, 'map', 'truth'),
    Topic('overhead/wheel_slip', JOINTS, WheelSlip, partial(
        wheel_slip_from_msg, topic='overhead/wheel_slip'), wheel_slip_to_msg,
        30.0, 'base_link', 'truth'),
)}


def _typed(topic: Topic) -> Topic:
    """Return the topic with the samples of ``topic`` in messages of smart_tire_msgs."""
    form = FORMS[topic.sample]
    return replace(topic, name=topic.name + SUFFIX, type=form.type,
                   from_msg=lambda msg: topic.from_msg(form.joints(msg)),
                   to_msg=lambda msg, sample: form.fill(msg, sample, topic.frame))


TYPED: dict[str, Topic] = {  # standard name -> topic with these samples, or batches of them
    **{name: _typed(topic) for name, topic in TOPICS.items() if topic.sample in FORMS},
    'tire_samples': replace(
        TOPICS['tire_samples'], name='tire_samples' + SUFFIX, type=BATCH.type, sample=TireSamples,
        from_msg=samples_from_msg, to_msg=samples_to_msg, rate=BATCH_RATE)}
ALL_TOPICS = TOPICS | {topic.name: topic for topic in TYPED.values()}
# reversed: of topics with the same sample class the first counts, which is not the ground truth
_NAME_OF = {topic.sample: topic.name for topic in reversed(TOPICS.values())}


def topic_of(sample: Sample) -> str:
    """Return the name of the first topic in ``TOPICS`` that has samples of this class."""
    return _NAME_OF[type(sample)]


def forms_of(standard: str) -> dict[str, Topic]:
    """Return message type -> topic with the samples of ``standard``, a name in ``TOPICS``."""
    return {topics[standard].type: topics[standard] for topics in (TOPICS, TYPED)
            if standard in topics}


def find_topic(name: str) -> Topic | None:
    """Return the topic whose name ``name`` is, in any namespace; None if there is none."""
    parts = name.strip('/').split('/')
    for start in range(len(parts)):  # longest match first: ground_truth/odom is not odom
        if (topic := ALL_TOPICS.get('/'.join(parts[start:]))) is not None:
            return topic
    return None
