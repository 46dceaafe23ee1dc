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
Publish the description of the robot and show it in RViz; included by the other launch files.

The URDF is generated from the parameter files. robot_state_publisher reads the wheel angles in
``wheel_states``. Where it is not installed, the launch continues without it.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, TimerAction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from smart_tire.launching import (
    boolean, check_arguments, file, is_described, PUBLISHER, text, TRANSFORMS, viewer)
from smart_tire.parameters import load_robot
from smart_tire.parameters.urdf_writer import urdf_text

FILES = {  # parameter file -> its content
    'robot': 'geometry, tires, films and sensors',
    'tuning': 'estimators',
}
ARGUMENTS = {'namespace': text, 'description': boolean, 'rviz': viewer,
             **dict.fromkeys(FILES, file)}
# s; these programs do not unblock SIGINT: they start when hold_interrupts has ended.
START_DELAY = 0.5


def describe(context):
    """Return robot_state_publisher and RViz, those that are wanted."""
    chosen = context.launch_configurations
    programs = []
    if is_described(chosen['description']):
        programs.append(state_publisher([chosen[name] for name in FILES]))
    if viewer(chosen['rviz']):
        programs.append(rviz())
    actions = [TimerAction(period=START_DELAY, actions=programs)] if programs else []
    if boolean(chosen['description']) and not is_described(chosen['description']):
        actions.append(LogInfo(msg=f'{PUBLISHER} is not installed: robot_description is not '
                                   'published'))
    return actions


def state_publisher(files):
    """Return robot_state_publisher with the URDF of the robot in parameter files."""
    robot = load_robot(files)
    urdf = ParameterValue(urdf_text(robot), value_type=str)
    return Node(package=PUBLISHER, executable=PUBLISHER, output='screen',
                namespace=LaunchConfiguration('namespace'),
                parameters=[{'robot_description': urdf, 'frame_prefix': robot.frame_prefix}],
                remappings=[('joint_states', 'wheel_states'), *TRANSFORMS])


def rviz():
    """Return RViz with the view of this package."""
    view = PathJoinSubstitution(
        [FindPackageShare('smart_tire'), 'config', 'view', 'smart_tire.rviz'])
    return Node(package='rviz2', executable='rviz2', output='screen',
                namespace=LaunchConfiguration('namespace'), remappings=TRANSFORMS,
                arguments=['-d', view])


def generate_launch_description():
    """Return robot_state_publisher, if it is installed, and RViz, both if they are wanted."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of all nodes'),
        DeclareLaunchArgument('description', default_value='true',
                              description='start robot_state_publisher, if it is installed'),
        DeclareLaunchArgument('rviz', default_value='false', description='start RViz'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, content in FILES.items()),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=describe),
    ])
