# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start the simulated robot and all nodes of the real one, connected to it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from smart_tire.launching import (
    boolean, CAMERA, check_arguments, enclave, file, hold_interrupts, parameters_of, text, viewer)

FILES = {  # parameter file -> its content
    'robot': 'geometry, tires, films and sensors',
    'simulation': 'ground, drive, radio, ports and camera',
    'tuning': 'estimators and controllers',
}
PORTS = {f'ports.{name}': f'simulated:{name}' for name in ('tire_radio', 'imu', 'motors')}
ARGUMENTS = {'namespace': text, 'respawn': boolean, 'description': boolean, 'rviz': viewer,
             'composed': boolean, 'camera': boolean, **dict.fromkeys(FILES, file),
             'simulation': parameters_of('robot_simulator')}


def simulation(context):
    """
    Return the simulator, and ``robot.launch.py`` with drivers that open its ports only.

    As the result of a function, other arguments of ``robot.launch.py``, such as ``simulated``,
    are not listed by ``ros2 launch --show-args``.
    """
    own = 'simulation', 'camera'
    same = {name: LaunchConfiguration(name) for name in ARGUMENTS if name not in own}
    camera = CAMERA if boolean(context.launch_configurations['camera']) else ()
    return [
        *(Node(package='smart_tire', executable=node, output='screen',
               namespace=LaunchConfiguration('namespace'), ros_arguments=enclave(context, node),
               parameters=[LaunchConfiguration('robot'), LaunchConfiguration('simulation'), *more])
          for node, *more in (('robot_simulator', PORTS), *zip(camera))),
        IncludeLaunchDescription(
            PathJoinSubstitution([FindPackageShare('smart_tire'), 'launch', 'robot.launch.py']),
            launch_arguments={**same, 'hardware': LaunchConfiguration('simulation'),
                              'simulated': 'true'}.items())]


def generate_launch_description():
    """Return the simulator and the robot."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of all nodes'),
        DeclareLaunchArgument('respawn', default_value='true',
                              description='restart nodes that die, as in robot.launch.py'),
        DeclareLaunchArgument('description', default_value='true',
                              description='start robot_state_publisher, if it is installed'),
        DeclareLaunchArgument('rviz', default_value='false', description='start RViz'),
        DeclareLaunchArgument('composed', default_value='false',
                              description='processes as in robot.launch.py'),
        DeclareLaunchArgument('camera', default_value='false',
                              description='start a simulated camera above the floor, and '
                                          'overhead_localizer'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, content in FILES.items()),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=hold_interrupts),
        OpaqueFunction(function=simulation),
    ])
