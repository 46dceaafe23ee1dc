# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start the estimators with the drivers of another base, such as those of ros2_control."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from smart_tire.launching import (
    boolean, check_arguments, file, hold_interrupts, text, topic, viewer)

ARGUMENTS = {'namespace': text, 'params': file, 'imu': topic, 'wheel_states': topic,
             'use_sim_time': boolean, 'respawn': boolean, 'description': boolean, 'rviz': viewer}
FILES = ('robot', 'tuning')  # arguments of robot.launch.py that are ``params`` here


def estimators(context):
    """
    Return ``robot.launch.py`` without drivers and controllers.

    As the result of a function, its other arguments are not listed by
    ``ros2 launch --show-args``.
    """
    same = {name: LaunchConfiguration(name) for name in ARGUMENTS if name != 'params'}
    return [IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare('smart_tire'), 'launch', 'robot.launch.py']),
        launch_arguments={**same, **dict.fromkeys(FILES, LaunchConfiguration('params')),
                          'drivers': 'false', 'control': 'false'}.items())]


def generate_launch_description():
    """Return the estimators."""
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of the nodes, that of the base'),
        DeclareLaunchArgument('params', description='parameter file of the base, such as '
                                                    'config/platforms/husky.yaml'),
        DeclareLaunchArgument('imu', default_value='imu/data', description='topic of the IMU'),
        DeclareLaunchArgument('wheel_states', default_value='joint_states',
                              description='topic of the wheels, such as that of '
                                          'joint_state_broadcaster'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='time from /clock'),
        DeclareLaunchArgument('respawn', default_value='true',
                              description='restart nodes that die'),
        DeclareLaunchArgument('description', default_value='false',
                              description='start robot_state_publisher with the URDF of this '
                                          'package; the base has its own'),
        DeclareLaunchArgument('rviz', default_value='false', description='start RViz'),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=hold_interrupts),
        OpaqueFunction(function=estimators),
    ])
