# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Samples to messages and back, by attribute access and without importing ROS.

Messages may be those of rclpy, of rosbags (numpy arrays) or plain namespaces (lists).
``x_from_msg`` matches joints by name, in any order, and ignores additional ones; it raises
MessageError, naming topic and field, for a message that docs/topics.md does not allow.
``x_to_msg`` writes a sample into a message, new or written by it before, and returns it.
"""

from smart_tire.messages.diagnostics import NodeStatus, statuses_from_msg
from smart_tire.messages.header import set_header, stamp_of
from smart_tire.messages.joint_names import OtherJointsError, recognized_joints, resolved_joints
from smart_tire.messages.joint_state import (
    film_names, friction_from_msg, friction_to_msg, ground_state_from_msg, ground_state_to_msg,
    motor_command_from_msg, motor_command_to_msg, tire_from_msg, tire_to_msg,
    wheel_command_from_msg, wheel_command_to_msg, wheel_slip_from_msg, wheel_slip_to_msg,
    wheels_from_msg, wheels_to_msg)
from smart_tire.messages.odometry_imu import (
    battery_from_msg, battery_to_msg, icr_from_msg, icr_to_msg, imu_from_msg, imu_mounting_to_msg,
    imu_to_msg, odometry_from_msg, odometry_to_msg, transform_to_msg, velocity_from_msg,
    velocity_from_twist, velocity_to_msg)
from smart_tire.messages.path import (
    goal_from_msg, goal_to_msg, path_from_msg, path_to_msg, progress_from_msg, progress_to_msg)
from smart_tire.messages.serialized_path import path_from_bytes
from smart_tire.messages.topics import find_topic, Topic, topic_of, TOPICS

__all__ = [
    'battery_from_msg', 'battery_to_msg', 'film_names', 'find_topic', 'friction_from_msg',
    'friction_to_msg', 'goal_from_msg', 'goal_to_msg', 'ground_state_from_msg',
    'ground_state_to_msg', 'icr_from_msg', 'icr_to_msg', 'imu_from_msg', 'imu_mounting_to_msg',
    'imu_to_msg', 'motor_command_from_msg', 'motor_command_to_msg', 'NodeStatus',
    'odometry_from_msg', 'odometry_to_msg', 'OtherJointsError', 'path_from_bytes', 'path_from_msg',
    'path_to_msg', 'progress_from_msg', 'progress_to_msg', 'recognized_joints', 'resolved_joints',
    'set_header', 'stamp_of', 'statuses_from_msg', 'tire_from_msg', 'tire_to_msg', 'Topic',
    'topic_of', 'TOPICS', 'transform_to_msg', 'velocity_from_msg', 'velocity_from_twist',
    'velocity_to_msg', 'wheel_command_from_msg', 'wheel_command_to_msg', 'wheel_slip_from_msg',
    'wheel_slip_to_msg', 'wheels_from_msg', 'wheels_to_msg']
