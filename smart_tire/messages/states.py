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

"""Topics without samples: states of the motors, transforms and diagnostics."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.messages.contents import Content, Field


@dataclass(frozen=True)
class StateTopic:
    """A topic whose messages are not converted to samples."""

    name: str
    type: str  # noqa: A003
    content: Content
    frame: str | None = None  # header.frame_id; None: no header


BOOL = 'std_msgs/msg/Bool'
ON_CHANGE = 'on change and 1 Hz'
STATE_TOPICS: dict[str, StateTopic] = {topic.name: topic for topic in (
    StateTopic('emergency_stop_active', BOOL, Content(
        'state of the emergency stop', (
            Field('data', '', 'whether the emergency stop is latched'),), rate=ON_CHANGE)),
    StateTopic('motors_enabled', BOOL, Content(
        'whether the output stage accepts commands', (
            Field('data', '', 'false while anything except the absence of a command stops the '
                  'motors: emergency stop, hold, trip, not armed'),), rate=ON_CHANGE)),
    StateTopic('/tf', 'tf2_msgs/msg/TFMessage', Content(
        'the pose of `odom` as a transform; only if `tf2_msgs` is installed', (
            Field('transforms', '', 'one transform from `odom` to `base_link`'),),
        rate='125 Hz'), 'odom'),
    StateTopic('/tf_static', 'tf2_msgs/msg/TFMessage', Content(
        'the mounting of the IMU, unless `publish_imu_tf` is false; only if `tf2_msgs` is '
        'installed', (
            Field('transforms', '', 'one transform from `base_link` to `imu_link`, from the '
                  'parameters `imu.position` and `imu.rotation`'),),
        rate='once, transient local'), 'base_link'),
    StateTopic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', Content(
        'health of each node', (
            Field('status', '', 'one status: name of the node, level (0 ok, 1 warning, 2 error), '
                  'message, exact counts as key-value pairs'),), rate='1 Hz per node'), ''),
)}
