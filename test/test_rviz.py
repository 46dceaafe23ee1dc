# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The view for RViz: its topics exist, with types and profiles that match."""

from __future__ import annotations

from pathlib import Path

import pytest
from smart_tire.messages import TOPICS
from smart_tire.parameters import RobotParams
from smart_tire.samples import GoalPose
import yaml

VIEW = Path(__file__).resolve().parents[1] / 'config' / 'view' / 'smart_tire.rviz'
MANAGER = yaml.safe_load(VIEW.read_text(encoding='utf-8'))['Visualization Manager']
DISPLAYS = {display['Name']: display for display in MANAGER['Displays']}
TYPES = {  # class of a display -> type of its topic
    'Odometry': 'nav_msgs/msg/Odometry', 'PointStamped': 'geometry_msgs/msg/PointStamped',
    'Path': 'nav_msgs/msg/Path', 'RobotModel': 'std_msgs/msg/String'}
STANDARD = {'robot_description': 'std_msgs/msg/String'}
LATCHED = {*STANDARD, 'path'}  # transient local


def kind(display):
    """Return the class of a display, without its package."""
    package, _, name = display['Class'].partition('/')
    assert package == 'rviz_default_plugins'  # part of every desktop installation
    return name


def topic(display):
    """Return the topic of a display, None if it has none of its own."""
    return display.get('Topic') or display.get('Description Topic')


with_topic = pytest.mark.parametrize('display', list(filter(topic, DISPLAYS.values())),
                                     ids=lambda display: display['Name'])


def test_robot_frames_estimate_and_ground_truth_are_shown_in_odom():
    assert MANAGER['Global Options']['Fixed Frame'] == 'odom'
    shown = {(kind(display), (topic(display) or {}).get('Value')) for display in DISPLAYS.values()
             if display['Enabled']}
    assert shown >= {('RobotModel', 'robot_description'), ('TF', None), ('Odometry', 'odom'),
                     ('Odometry', 'ground_truth/odom'), ('PointStamped', 'icr'),
                     ('Path', 'path')}


def test_the_tool_for_goals_publishes_what_the_controller_subscribes_to():
    tool, = (tool for tool in MANAGER['Tools'] if tool['Class'].endswith('/SetGoal'))
    assert TOPICS[tool['Topic']['Value']].sample is GoalPose  # in the fixed frame, odom
    assert tool['Topic']['Reliability Policy'] == 'Reliable'


@with_topic
def test_each_topic_exists_and_has_the_type_of_its_display(display):
    name = topic(display)['Value']
    known = {**{name: item.type for name, item in TOPICS.items()}, **STANDARD}
    assert known[name] == TYPES[kind(display)]


@with_topic
def test_each_subscription_matches_its_publisher(display):
    profile = topic(display)
    assert profile['Reliability Policy'] == 'Reliable'
    latched = profile['Value'] in LATCHED
    assert profile['Durability Policy'] == ('Transient Local' if latched else 'Volatile')


def test_the_grid_is_the_ground_under_the_robot_of_the_default_parameters():
    grid, = (display for display in DISPLAYS.values() if kind(display) == 'Grid')
    assert grid['Offset']['Z'] == -RobotParams().wheel_radius  # odom is at axle height
