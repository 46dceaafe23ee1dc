# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start a buckling film as a sensor: its driver, or a simulated film, and the estimator."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from smart_tire.errors import ParameterError
from smart_tire.launching import (
    boolean, check_arguments, enclave, file, FILM, FILM_SIMULATOR, hold_interrupts, text)

CONFIG = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
FILES = {'robot': 'frames of the robot', 'film': 'film, amplifier and simulation'}


def calibration(value):
    """Return the path of a file, or an empty text; raise ValueError if there is none."""
    return value and file(value)


ARGUMENTS = {'namespace': text, 'calibration': calibration, 'simulated': boolean,
             **dict.fromkeys(FILES, file)}


def start(context):
    """Return the nodes; raise ParameterError if a real film has no calibration."""
    chosen = context.launch_configurations
    simulated, calibrated = boolean(chosen['simulated']), chosen['calibration']
    if not (simulated or calibrated):
        raise ParameterError('calibration:= is missing, expected a file of "smart_tire identify '
                             'film" for this film')
    own = {'film_sensor': [{'calibration_file': calibrated or PathJoinSubstitution(
        [CONFIG, 'calibration', 'simulated_film.yaml'])}],
           **({'film_driver': [{'port': 'simulated'}]} if simulated else {})}
    return [Node(package='smart_tire', executable=node, output='screen',
                 namespace=LaunchConfiguration('namespace'), ros_arguments=enclave(context, node),
                 parameters=[*map(LaunchConfiguration, FILES), *own.get(node, [])])
            for node in ((FILM_SIMULATOR,) if simulated else ()) + FILM]


def generate_launch_description():
    """Return the nodes of one film."""
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of all nodes, one for each film'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([CONFIG, f'{name}.yaml']))
          for name, content in FILES.items()),
        DeclareLaunchArgument('calibration', default_value='',
                              description='file of "smart_tire identify film" for this film; '
                                          'empty: that of the simulated film'),
        DeclareLaunchArgument('simulated', default_value='false',
                              description='start a simulated film, and open its port only'),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=hold_interrupts),
        OpaqueFunction(function=start),
    ])
