# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Table of the nodes: what each does, its topics and its services."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Service:
    """A service of a node."""

    name: str
    type: str  # noqa: A003
    meaning: str
    condition: str = ''  # under which the node offers it


@dataclass(frozen=True)
class NodeEntry:
    """One node; its topics are names of ``describe.TOPIC_NAMES``."""

    name: str
    purpose: str
    subscribes: tuple[str, ...]
    publishes: tuple[str, ...]
    services: tuple[Service, ...] = ()


DIAGNOSTICS = '/diagnostics'  # published by every node
NODE_TABLE: dict[str, NodeEntry] = {node.name: node for node in (
    NodeEntry(
        'tire_receiver',
        'Receives the radio batches of the sensor nodes in the tires from an XBee coordinator '
        '(API mode 2) and publishes one message per A/D conversion, stamped with its instant.',
        (), ('tire_samples', 'tire_battery')),
    NodeEntry(
        'imu_driver',
        'Reads an IMU (VectorNav binary or ASCII, Xsens MTData2) and publishes its samples in '
        'REP-103 axes, stamped by the clock of the device if frames contain it.',
        (), ('imu/data',)),
    NodeEntry(
        'motor_driver',
        'Output stage of the robot: polls encoders and currents of two RoboClaw boards, applies '
        'duties, supervises boards and wheels, and serves the emergency stop.',
        ('motor_commands',), ('wheel_states', 'emergency_stop_active', 'motors_enabled'), (
            Service('emergency_stop', 'std_srvs/srv/SetBool',
                    '`true` latches the stop; `success` only if both boards acknowledged zero '
                    'duty within 0.4 s. `false` releases it, not within `release_hold_off` after '
                    'the latest request; a new command is needed'),
            Service('arm', 'std_srvs/srv/SetBool',
                    'enables (or disables) the output; refused while the emergency stop is '
                    'latched or a hold is active', 'only with `require_arming: true`'))),
    NodeEntry(
        'slip_estimator',
        'Extended Kalman filter: pose, velocity, slip of each wheel and center of rotation from '
        'IMU, wheels and the state of the ground.',
        ('imu/data', 'wheel_states', 'ground_state'),
        ('odom', '/tf', '/tf_static', 'wheel_slip', 'icr'), (
            Service('reset_odometry', 'std_srvs/srv/Trigger',
                    'makes the present pose the origin of `odom`; biases and slips are kept'),)),
    NodeEntry(
        'friction_estimator',
        'Tire-road friction coefficient of each patch crossing of the films, and state of the '
        'ground from films, IMU, wheels and motor torques.',
        ('imu/data', 'wheel_states', 'tire_samples', 'odom'),
        ('tire_friction', 'ground_state')),
    NodeEntry(
        'wheel_controller',
        'Controls the wheel speeds, one PID controller per wheel, for the velocity command in '
        'force; with `traction.enabled` within the slip that friction permits.',
        ('cmd_vel', 'wheel_states', 'emergency_stop_active', 'motors_enabled', 'odom',
         'tire_friction'),
        ('wheel_commands', 'motor_commands')),
    NodeEntry(
        'trajectory_controller',
        'Follows a path or drives to a goal on `odom`, and compensates the slip of the wheels in '
        'its velocity commands.',
        ('path', 'goal_pose', 'odom', 'wheel_states', 'wheel_slip', 'tire_friction',
         'emergency_stop_active'),
        ('cmd_vel', 'path_progress'), (
            Service('cancel_path', 'std_srvs/srv/Trigger',
                    'stops the robot; `success` only if it followed a path, drove to a goal or '
                    'held after arrival'),)),
    NodeEntry(
        'robot_simulator',
        'Simulated robot in real time: opens pseudo-terminals and emits the bytes of tire radio, '
        'IMU and motor boards, so that the drivers used are those of the hardware.',
        (), ('ground_truth/odom', 'ground_truth/wheel_slip', 'ground_truth/tire_friction')),
)}


def publishers_of(topic: str) -> tuple[str, ...]:
    """Return the nodes that publish ``topic``."""
    return tuple(node.name for node in NODE_TABLE.values()
                 if topic in (*node.publishes, DIAGNOSTICS))


def subscribers_of(topic: str) -> tuple[str, ...]:
    """Return the nodes that subscribe to ``topic``."""
    return tuple(node.name for node in NODE_TABLE.values() if topic in node.subscribes)
