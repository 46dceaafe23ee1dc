# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire topics``: list and description of topics."""

from __future__ import annotations

from smart_tire.cli.main import main
from smart_tire.messages.describe import TOPIC_NAMES


def test_all_topics_are_listed_with_their_meaning(capsys):
    assert main(['topics']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(any(line.startswith(name) for line in lines) for name in TOPIC_NAMES)
    assert 'wheel_slip' + ' ' * 20 + 'longitudinal slip of the four wheels' in lines


def test_fields_publisher_and_subscribers_of_topics_are_printed(capsys):
    assert main(['topics', '/robot/wheel_slip', '/tf']) == 0
    first, second = capsys.readouterr().out.split('\n\n')
    assert first.startswith('wheel_slip  [sensor_msgs/msg/JointState]')
    assert 'velocity [m/s]  slip velocity r omega - v_x' in first
    assert 'published by slip_estimator; subscribers: trajectory_controller' in first
    assert second.startswith('/tf  [tf2_msgs/msg/TFMessage]')
    assert second.endswith('published by slip_estimator; subscribers: trajectory_controller\n')


def test_an_unknown_topic_is_a_usage_error_that_lists_the_known_ones(capsys):
    assert main(['topics', 'odom', 'voltage']) == 2
    out, err = capsys.readouterr()
    assert out == ''
    assert 'voltage: no topic of this package; known: imu/data, ' in err
    assert main(['topics', 'wheel_slp']) == 2
    assert 'wheel_slp: no topic of this package, did you mean wheel_slip?' in (
        capsys.readouterr().err)
