# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start the drivers, the estimators and the controllers of one robot."""

import time

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction, TimerAction)
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from smart_tire.launching import (
    boolean, check_arguments, file, hold_interrupts, is_described, parameters_of, text,
    TRANSFORMS, viewer)
from smart_tire.parameters import FILES as PARAMETER_FILES

PORTS = {'motor_driver': 'motors', 'imu_driver': 'imu', 'tire_receiver': 'tire_radio'}
NODES = [node for file in ('hardware.yaml', 'tuning.yaml') for node in PARAMETER_FILES[file]
         if node != 'slip_estimator']  # which is started in another way
FILES = {  # parameter file -> its content
    'robot': 'geometry, tires, films and sensors',
    'hardware': 'drivers and ports',
    'tuning': 'estimators and controllers',
}
ARGUMENTS = {'namespace': text, 'respawn': boolean, 'description': boolean, 'rviz': viewer,
             'simulated': boolean, **dict.fromkeys(FILES, file),
             'hardware': parameters_of(*PORTS, 'robot_simulator')}  # of which the file may be
DESCRIBED = ('namespace', 'description', 'rviz', 'robot', 'tuning')  # arguments of description.py
RESPAWN_DELAY = 2.0  # s, so that a port can reappear and the log remains readable
MAX_RESPAWN_DELAY = 60.0  # s, of a node that dies again and again
ENDED = (0, 2)  # exit status: interrupted, wrong arguments or parameters
STOP = {'start_stopped': True}


def supervised(context, executable, *parameters, wait=0.0):
    """
    Return a node, started ``wait`` [s] from now, that starts again when it dies.

    The wait doubles up to ``MAX_RESPAWN_DELAY`` until the node has run that long. A node that
    ended by itself, also because of wrong parameters, is not started again. motor_driver restarts
    with the emergency stop latched: an operator has to release it.
    """
    begin = time.monotonic() + wait

    def restart(event, context):
        if (context.is_shutdown or event.returncode in ENDED
                or not boolean(context.launch_configurations['respawn'])):
            return []
        lasted = time.monotonic() - begin > MAX_RESPAWN_DELAY
        period = min(2.0 * wait, MAX_RESPAWN_DELAY) if wait and not lasted else RESPAWN_DELAY
        stop = [STOP] if executable == 'motor_driver' and STOP not in parameters else []
        return [TimerAction(period=period, actions=[
            supervised(context, executable, *parameters, *stop, wait=period)])]

    space = context.launch_configurations['namespace'].strip('/')
    enclave = '/'.join(('', *filter(None, (space, executable))))  # docs/how_to/security.md
    return Node(package='smart_tire', executable=executable, output='screen',
                namespace=LaunchConfiguration('namespace'), remappings=TRANSFORMS,
                parameters=[*map(LaunchConfiguration, FILES), *parameters],
                ros_arguments=['--enclave', enclave], on_exit=restart)


def port_of(executable, context):
    """Return the parameter that makes a driver of a simulated robot open no real device."""
    if executable not in PORTS or not boolean(context.launch_configurations['simulated']):
        return []
    return [{'port': f'simulated:{PORTS[executable]}'}]


def start(context):
    """Return one process per node, all with the same parameter files."""
    return [supervised(context, node, *port_of(node, context)) for node in NODES]


def describe(context):
    """Return the description of the robot, and slip_estimator without its static transform."""
    described = is_described(context.launch_configurations['description'])
    own = [{'publish_imu_tf': False}] if described else []
    return [
        IncludeLaunchDescription(
            PathJoinSubstitution([FindPackageShare('smart_tire'), 'launch', 'description.py']),
            launch_arguments={name: LaunchConfiguration(name) for name in DESCRIBED}.items()),
        supervised(context, 'slip_estimator', *own),
    ]


def generate_launch_description():
    """Return the drivers, the estimators and the controllers."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of all nodes'),
        DeclareLaunchArgument('respawn', default_value='true',
                              description='restart nodes that die; motor_driver with the '
                                          'emergency stop latched'),
        DeclareLaunchArgument('description', default_value='true',
                              description='start robot_state_publisher, if it is installed'),
        DeclareLaunchArgument('rviz', default_value='false', description='start RViz'),
        DeclareLaunchArgument('simulated', default_value='false',
                              description='open the ports of robot_simulator in this namespace, '
                                          'whatever the parameter files say'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, content in FILES.items()),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=hold_interrupts),
        OpaqueFunction(function=start),
        OpaqueFunction(function=describe),
    ])
