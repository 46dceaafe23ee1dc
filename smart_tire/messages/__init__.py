# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Samples to messages and back, by attribute access and without importing ROS.

Messages may be those of rclpy, of rosbags (numpy arrays) or plain namespaces (lists).
``x_from_msg`` matches joints by name, in any order, and ignores additional ones; it raises
MessageError, naming topic and field, for a message that docs/topics.md does not allow.
``x_to_msg`` writes a sample into a message, new or written by it before, and returns it. Both are
in ``TOPICS``, by topic.
"""

from smart_tire.messages.cdr import FIELDS, LayoutDecoder, LayoutEncoder, stamp_in
from smart_tire.messages.header import NANOSEC, NodeStatus, stamp_of, statuses_from_msg
from smart_tire.messages.joint_names import OtherJointsError, resolved_joints
from smart_tire.messages.joint_state import (
    tire_from_msg, tires_from_columns, wheel_slip_numbers, wheels_from_msg)
from smart_tire.messages.odometry_imu import (
    icr_numbers, imu_from_msg, imu_mounting_to_msg, imu_to_msg, imus_from_columns,
    odometry_numbers, transform_to_msg, velocity_from_twist)
from smart_tire.messages.path import (
    check_pose_count, path_from_bytes, path_from_msg, transform_from_msg)
from smart_tire.messages.topics import (
    ALL_TOPICS, find_topic, forms_of, IMAGES, Topic, topic_of, TOPICS, TYPED)
from smart_tire.messages.typed import definitions

__all__ = [
    'ALL_TOPICS', 'check_pose_count', 'definitions', 'FIELDS', 'find_topic', 'forms_of',
    'icr_numbers', 'IMAGES', 'imu_from_msg', 'imu_mounting_to_msg', 'imu_to_msg',
    'imus_from_columns', 'LayoutDecoder', 'LayoutEncoder', 'NANOSEC', 'NodeStatus',
    'odometry_numbers', 'OtherJointsError', 'path_from_bytes', 'path_from_msg', 'resolved_joints',
    'stamp_in', 'stamp_of', 'statuses_from_msg', 'tire_from_msg', 'tires_from_columns', 'Topic',
    'topic_of', 'TOPICS', 'transform_from_msg', 'transform_to_msg', 'TYPED',
    'velocity_from_twist', 'wheel_slip_numbers', 'wheels_from_msg']
