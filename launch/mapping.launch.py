# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start the node that maps the friction on the tracks of a running robot."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from smart_tire.launching import (
    boolean, check_arguments, enclave, file, hold_interrupts, MAPPER, text, TRANSFORMS)

FILES = {'robot': 'geometry of the robot', 'mapping': 'friction mapper'}
ARGUMENTS = {'namespace': text, 'use_sim_time': boolean, **dict.fromkeys(FILES, file)}


def start(context):
    """Return the node."""
    clock = [{'use_sim_time': boolean(context.launch_configurations['use_sim_time'])}]
    return [Node(package='smart_tire', executable=MAPPER, output='screen',
                 namespace=LaunchConfiguration('namespace'), remappings=TRANSFORMS,
                 parameters=[*map(LaunchConfiguration, FILES), *clock],
                 ros_arguments=enclave(context, MAPPER))]


def generate_launch_description():
    """Return the friction mapper."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='', description='that of the robot'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='time from /clock'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, content in FILES.items()),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=hold_interrupts),
        OpaqueFunction(function=start),
    ])
