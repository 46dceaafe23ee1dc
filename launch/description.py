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

URDF and frames are those of the parameter files. robot_state_publisher reads the wheel angles in
``wheel_states``. Where it is not installed, the launch continues without it.
"""

from pathlib import Path
from tempfile import NamedTemporaryFile

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, TimerAction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from smart_tire.launching import (
    boolean, check_arguments, enclave, file, is_described, PUBLISHER, text, topic, TRANSFORMS,
    view_of, viewer)
from smart_tire.parameters import load_robot
from smart_tire.parameters.urdf_writer import urdf_text

FILES = {  # parameter file -> its content
    'robot': 'geometry, tires, films and sensors',
    'tuning': 'estimators',
}
ARGUMENTS = {'namespace': text, 'description': boolean, 'rviz': viewer, 'use_sim_time': boolean,
             'wheel_states': topic, **dict.fromkeys(FILES, file)}
# s; these programs do not unblock SIGINT: they start when hold_interrupts has ended.
START_DELAY = 0.5


def describe(context):
    """Return robot_state_publisher and RViz, those that are wanted."""
    chosen = context.launch_configurations
    actions, wanted = [], [make for make, is_wanted in (
        (state_publisher, is_described(chosen['description'])), (rviz, viewer(chosen['rviz'])))
        if is_wanted]
    if wanted:
        robot = load_robot([chosen[name] for name in FILES])
        actions.append(TimerAction(period=START_DELAY, actions=[
            make(context, robot) for make in wanted]))
    if boolean(chosen['description']) and not is_described(chosen['description']):
        actions.append(LogInfo(msg=f'{PUBLISHER} is not installed: robot_description is not '
                                   'published'))
    return actions


def state_publisher(context, robot):
    """Return robot_state_publisher with the URDF of ``robot``."""
    urdf = ParameterValue(urdf_text(robot), value_type=str)
    return program(context, PUBLISHER, PUBLISHER,
                   parameters=[{'robot_description': urdf, 'frame_prefix': robot.frame_prefix}],
                   remappings=[('joint_states', LaunchConfiguration('wheel_states'))])


def rviz(context, robot):
    """Return RViz with the view of this package, in the frames of ``robot``."""
    view = PathJoinSubstitution(
        [FindPackageShare('smart_tire'), 'config', 'view', 'smart_tire.rviz']).perform(context)
    with NamedTemporaryFile('w', suffix='.rviz', encoding='utf-8', delete=False) as own:
        own.write(view_of(Path(view).read_text(encoding='utf-8'), robot))
    return program(context, 'rviz2', 'operator', arguments=['-d', own.name])


def program(context, package, role, *, parameters=(), remappings=(), arguments=()):
    """Return a program of another package; ``role`` names its enclave in the security policy."""
    clock = {'use_sim_time': boolean(context.launch_configurations['use_sim_time'])}
    return Node(package=package, executable=package, output='screen', arguments=arguments,
                namespace=LaunchConfiguration('namespace'), parameters=[*parameters, clock],
                remappings=[*remappings, *TRANSFORMS], ros_arguments=enclave(context, role))


def generate_launch_description():
    """Return robot_state_publisher, if it is installed, and RViz, both if they are wanted."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of all nodes'),
        DeclareLaunchArgument('description', default_value='true',
                              description='start robot_state_publisher, if it is installed'),
        DeclareLaunchArgument('rviz', default_value='false', description='start RViz'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='time from /clock'),
        DeclareLaunchArgument('wheel_states', default_value='wheel_states',
                              description='topic with the angles of the wheels'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, content in FILES.items()),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=describe),
    ])
