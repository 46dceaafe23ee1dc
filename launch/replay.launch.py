# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start the estimators on a bag: ``ros2 launch smart_tire replay.launch.py bag:=DIR rate:=5``."""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction, Shutdown, TimerAction)
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from smart_tire.launching import (
    boolean, check_arguments, file, hold_interrupts, is_described, path, positive, text,
    TRANSFORMS, viewer)

ESTIMATORS = ('slip_estimator', 'friction_estimator')
FILES = {  # parameter file -> its content
    'robot': 'geometry, tires, films and sensors',
    'tuning': 'estimators',
}
ARGUMENTS = {'namespace': text, 'bag': path, 'rate': positive, 'description': boolean,
             'rviz': viewer, **dict.fromkeys(FILES, file)}
DESCRIBED = ('namespace', 'description', 'rviz', 'robot', 'tuning')  # arguments of description.py
ESTIMATOR_END_DELAY = 1.0  # s from the end of the bag to the end of the estimators
MAX_START_TIME = 30.0      # s for the estimators to start and match


def end(event, context):
    """Return the actions that end the launch after the replay, with an error if it failed."""
    if context.is_shutdown:
        return []
    last = OpaqueFunction(function=fail) if event.returncode else Shutdown(
        reason='the bag has ended')
    return [TimerAction(period=ESTIMATOR_END_DELAY, actions=[last])]


def fail(context):
    """End the launch with an error."""
    raise RuntimeError('the replay failed, estimates are missing or incomplete: see its log')


def estimator(executable, *parameters):
    """Return an estimator; ``parameters`` take precedence over the parameter files."""
    return Node(package='smart_tire', executable=executable, output='screen',
                namespace=LaunchConfiguration('namespace'), remappings=TRANSFORMS,
                parameters=[*map(LaunchConfiguration, FILES), *parameters])


def describe(context):
    """Return the description of the robot, and slip_estimator without its static transform."""
    described = is_described(context.launch_configurations['description'])
    own = [{'publish_imu_tf': False}] if described else []
    return [
        IncludeLaunchDescription(
            PathJoinSubstitution([FindPackageShare('smart_tire'), 'launch', 'description.py']),
            launch_arguments={name: LaunchConfiguration(name) for name in DESCRIBED}.items()),
        estimator('slip_estimator', *own),
    ]


def generate_launch_description():
    """Return the estimators and the replay, which waits for them; all end with the bag."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of the topics in the bag'),
        DeclareLaunchArgument('bag', description='rosbag2 directory'),
        DeclareLaunchArgument('rate', default_value='1',
                              description='multiple of the recorded rate'),
        DeclareLaunchArgument('description', default_value='true',
                              description='start robot_state_publisher, if it is installed'),
        DeclareLaunchArgument('rviz', default_value='false', description='start RViz'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, content in FILES.items()),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=hold_interrupts),
        OpaqueFunction(function=describe),
        estimator('friction_estimator'),
        Node(package='smart_tire', executable='smart_tire', output='screen',
             namespace=LaunchConfiguration('namespace'),
             arguments=['replay', LaunchConfiguration('bag'),
                        '--rate', LaunchConfiguration('rate'),
                        '--wait', str(MAX_START_TIME), '--wait-for', *ESTIMATORS],
             on_exit=end),
    ])
