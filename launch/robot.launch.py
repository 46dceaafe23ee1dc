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

from smart_tire.errors import ParameterError
from smart_tire.launching import (
    boolean, check_arguments, enclave, ENDED, file, hold_interrupts, is_described, parameters_of,
    respawn_delay, SEPARATE, STOP, text, topic, TRANSFORMS, viewer)
from smart_tire.nodes.command_line import COMPOSED, COMPOSED_NODES
from smart_tire.parameters import FILES as PARAMETER_FILES

DRIVERS = ('motor_driver', 'imu_driver', 'tire_receiver')
CONTROLLERS = ('wheel_controller', 'trajectory_controller')
NODES = [node for file in ('hardware.yaml', 'tuning.yaml') for node in PARAMETER_FILES[file]]
FILES = {  # parameter file -> its content
    'robot': 'geometry, tires, films and sensors',
    'hardware': 'drivers and ports',
    'tuning': 'estimators and controllers',
}
ARGUMENTS = {'namespace': text, 'respawn': boolean, 'description': boolean, 'rviz': viewer,
             'simulated': boolean, 'composed': boolean, 'drivers': boolean, 'control': boolean,
             'use_sim_time': boolean, 'imu': topic, 'wheel_states': topic,
             **dict.fromkeys(FILES, file),
             'hardware': parameters_of(*DRIVERS, 'robot_simulator')}  # of which the file may be
# arguments of description.py
DESCRIBED = ('namespace', 'description', 'rviz', 'use_sim_time', 'wheel_states', 'robot', 'tuning')


def supervised(context, executable, nodes, *parameters, wait=0.0):
    """
    Return a process, started ``wait`` [s] from now, that starts again when it dies.

    The wait grows (``respawn_delay``). A process that ended by itself, also because of wrong
    parameters, is not started again. motor_driver restarts with the emergency stop latched: an
    operator has to release it. ``nodes`` are those in a process of several.
    """
    begin = time.monotonic() + wait

    def restart(event, context):
        if (context.is_shutdown or event.returncode in ENDED
                or not boolean(context.launch_configurations['respawn'])):
            return []
        period = respawn_delay(wait, time.monotonic() - begin)
        stop = [STOP] if executable == 'motor_driver' and STOP not in parameters else []
        return [TimerAction(period=period, actions=[
            supervised(context, executable, nodes, *parameters, *stop, wait=period)])]

    topics = [('imu/data', LaunchConfiguration('imu')),
              ('wheel_states', LaunchConfiguration('wheel_states'))]
    return Node(package='smart_tire', executable=executable, arguments=nodes, output='screen',
                namespace=LaunchConfiguration('namespace'), remappings=[*topics, *TRANSFORMS],
                parameters=[*map(LaunchConfiguration, FILES), *parameters],
                ros_arguments=enclave(context, executable), on_exit=restart)


def processes(chosen):
    """Return executable -> nodes to name on its command line, those that are wanted."""
    left_out = [name for argument, names in (('drivers', DRIVERS), ('control', CONTROLLERS))
                if not boolean(chosen[argument]) for name in names]
    nodes = [name for name in NODES if name not in left_out]
    if not boolean(chosen['composed']):
        return {name: [] for name in nodes}
    return {COMPOSED: [name for name in COMPOSED_NODES if name in nodes],
            **{name: [] for name in SEPARATE if name in nodes}}


def start(context):
    """Return all processes, with the same parameter files."""
    chosen = context.launch_configurations
    simulated_time = boolean(chosen['use_sim_time'])
    if simulated_time and boolean(chosen['drivers']):
        raise ParameterError('use_sim_time:=true: drivers stamp with the time of the host, '
                             'add drivers:=false')
    clock = [{'use_sim_time': True}] if simulated_time else []
    # a driver of a simulated robot opens no real device
    port = [{'port': 'simulated'}] if boolean(chosen['simulated']) else []
    # the static transform is that of robot_state_publisher, if it is started
    transform = [{'publish_imu_tf': False}] if is_described(chosen['description']) else []
    return [
        IncludeLaunchDescription(
            PathJoinSubstitution([FindPackageShare('smart_tire'), 'launch', 'description.py']),
            launch_arguments={name: LaunchConfiguration(name) for name in DESCRIBED}.items()),
        *(supervised(context, name, nodes, *clock,
                     *(port if name in (COMPOSED, *DRIVERS) else []),
                     *(transform if name in (COMPOSED, 'slip_estimator') else []))
          for name, nodes in processes(chosen).items())]


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
        DeclareLaunchArgument('composed', default_value='false',
                              description='one process for all nodes but motor_driver and '
                                          'wheel_controller'),
        DeclareLaunchArgument('drivers', default_value='true',
                              description='start the drivers; another base has its own'),
        DeclareLaunchArgument('control', default_value='true',
                              description='start the controllers'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='time from /clock; only with drivers:=false'),
        DeclareLaunchArgument('imu', default_value='imu/data',
                              description='topic in place of imu/data'),
        DeclareLaunchArgument('wheel_states', default_value='wheel_states',
                              description='topic in place of wheel_states'),
        DeclareLaunchArgument('simulated', default_value='false',
                              description='open the ports of robot_simulator in this namespace, '
                                          'whatever the parameter files say'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {content}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, content in FILES.items()),
        OpaqueFunction(function=check_arguments, args=[ARGUMENTS]),
        OpaqueFunction(function=hold_interrupts),
        OpaqueFunction(function=start),
    ])
