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

"""
What the fields of each topic mean, with their units: the text of docs/topics.md and of ``--help``.

Names between backquotes are literal.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Field:
    """A field of a message, or a quantity in its list of names."""

    name: str     # path in the message, such as 'twist.twist.linear', or the name of a quantity
    unit: str     # '-' if dimensionless, '' if it is no number
    meaning: str


@dataclass(frozen=True)
class Content:
    """Meaning of the messages of a topic."""

    summary: str
    fields: tuple[Field, ...]
    quantities: tuple[Field, ...] = ()  # of a JointState that lists quantities by name
    rate: str = ''                      # replaces the nominal rate if it needs words


WHEEL_NAMES = Field('name', '', 'the wheels: `front_left`, `front_right`, `rear_left`, '
                    '`rear_right`; in foreign recordings in any order')
QUANTITY_NAMES = Field('name', '', 'the quantities below')
ONE_PER_CROSSING = 'one per patch crossing of all films of a wheel'

IMU = Content('specific force and angular rate in the axes of the IMU', (
    Field('linear_acceleration', 'm/s2', 'specific force: +9.81 on z when stationary and level'),
    Field('angular_velocity', 'rad/s', 'angular rate, z counter-clockwise'),
    Field('orientation', '-', 'unit quaternion, if the device sends one'),
    Field('orientation_covariance', 'rad2', 'first element -1: the device sends no orientation; '
          'all zero: covariance unknown (REP-145)')))
WHEEL_STATES = Content('motion and motor torque of the four wheels', (
    WHEEL_NAMES,
    Field('position', 'rad', 'unwrapped angle at the timestamp, positive rolling forward on both '
          'sides; may be empty or NaN in foreign recordings'),
    Field('velocity', 'rad/s', 'mean speed over the period that ends at the timestamp, on average '
          'half a period old'),
    Field('effort', 'N m', 'motor torque at the wheel, gear included, from the current measured '
          'at the timestamp, positive driving forward; NaN or empty where not measured; in old '
          'bags the duty, which is recognized by `motor_commands` and ignored')),
    rate='16 Hz (parameter `rate`, 1 to 200 Hz)')
TIRE_SAMPLES = Content('one A/D conversion of the films of one wheel, stamped with its instant', (
    Field('name', '', 'the films: `<wheel>_pvdf_1`, `<wheel>_pvdf_2`, ...; film 1 enters the '
          'contact patch first when rolling forward'),
    Field('position', 'V', 'amplifier output, 0 to 3.3, 1.65 at rest; a clipped sample has the '
          'value of the rail'),
    Field('velocity', '', 'empty'),
    Field('effort', '', 'empty')),
    rate='400 Hz per instrumented wheel')
TIRE_BATTERY = Content('battery of the sensor node of one wheel', (
    Field('voltage', 'V', 'battery voltage; everything that is not measured is NaN'),
    Field('location', '', 'the wheel')),
    rate='1 Hz per sensor node')
ODOM = Content('pose of `base_link` in `odom`, and its velocity', (
    Field('pose.pose.position', 'm', 'position; z is 0'),
    Field('pose.pose.orientation', '-', 'unit quaternion'),
    Field('twist.twist.linear', 'm/s', 'velocity in `base_link`: x forward, y to the left'),
    Field('twist.twist.angular', 'rad/s', 'z: yaw rate, counter-clockwise'),
    Field('pose.covariance', 'm2, rad2', 'row-major 6x6: x, y, z, rotation about x, y, z'),
    Field('twist.covariance', 'm2/s2, rad2/s2', 'row-major 6x6 in the same order')))
WHEEL_SLIP = Content('longitudinal slip of the four wheels', (
    WHEEL_NAMES,
    Field('position', '-', 'slip ratio in [-1, 1], positive when driving, in both directions of '
          'travel; -1 for a locked wheel on a moving robot; NaN if and only if |r omega| and the '
          '|v_x| of its center are both below `slip.standstill_speed`'),
    Field('velocity', 'm/s', 'slip velocity r omega - v_x of the wheel, never clipped'),
    Field('effort', '-', 'standard deviation of the slip ratio; 1 where it is NaN')))
ICR = Content('instantaneous center of rotation of the body in `base_link`', (
    Field('point.x', 'm', 'S of paper B'),
    Field('point.y', 'm', 'v_x over the yaw rate: turning radius, positive to the left'),
    Field('point.z', 'm', '0')),
    rate='125 Hz while the yaw rate exceeds 0.05 rad/s')
GROUND_STATE = Content('tire on the present ground and center of mass, from a window of films, '
                       'IMU, wheels and motor torques', (
    Field('header.stamp', '', 'end of the window; `slip_estimator` uses the state from '
          '`ground_delay` later on'),
    Field('name', '', 'the quantities below; a reader accepts others, and all but `stiffness` '
          'may be missing'),
    Field('position', '', 'values; NaN for a quantity that is not observable'),
    Field('velocity', '', 'empty'),
    Field('effort', '', 'standard deviations, infinite where the value is NaN; 0 for the '
          'correlation')), (
    Field('stiffness', 'N', 'longitudinal stiffness C_x of the present ground'),
    Field('friction_coefficient', '-', 'friction coefficient mu of the present ground'),
    Field('rolling_resistance', '-', 'rolling resistance over the load'),
    Field('lateral_share', '-', 'direction of the rolling resistance: 0 along the heading of the '
          'wheel, 1 along the velocity of its center'),
    Field('lateral_stiffness_ratio', '-', 'lateral over longitudinal stiffness, C_y / C_x'),
    Field('center_of_mass_x', 'm', 'center of mass in `base_link`, positive forward'),
    Field('center_of_mass_y', 'm', 'center of mass in `base_link`, positive to the left'),
    Field('stiffness_friction_correlation', '-', 'correlation of the errors of ln C_x and '
          'ln mu')),
    rate='2 Hz of message time, while films or motor torques show the ground')
TIRE_FRICTION = Content('friction coefficient and waveform of one patch crossing', (
    Field('name', '', 'the quantities below, all of them in each message'),
    Field('position', '', 'values; NaN for a quantity that is not observable in this crossing'),
    Field('velocity', '', 'empty'),
    Field('effort', '', 'standard deviations; infinite where the value is NaN')), (
    Field('friction_coefficient', '-', 'friction coefficient, from all measurements of the window '
          'and before'),
    Field('friction_coefficient_single', '-', 'friction coefficient from this revolution alone'),
    Field('adhesion_ratio', '-', 'adhesion length over contact length, L_a / L'),
    Field('adhesion_length', 'm', 'adhesion length L_a'),
    Field('stretch_voltage', 'V', 'maximum of the stretch part of film 1 (q_sm); NaN when '
          'braking'),
    Field('peak_interval', 's', 'Delta t_a of film 1, from the stretch peak to the release; NaN '
          'when braking'),
    Field('slip', '-', 'longitudinal slip ratio of the wheel, from the window'),
    Field('film_slip', '-', 'longitudinal slip ratio from the films and their calibrated gains '
          'alone'),
    Field('total_slip', '-', 'magnitude of the slip vector, from the window'),
    Field('normal_load', 'N', 'normal load F_z'),
    Field('stiffness', 'N', 'C_x of the present ground under this wheel'),
    Field('critical_slip', '-', '3 mu F_z / C_x with these values'),
    Field('traction_force', 'N', 'longitudinal force on the robot at this wheel from the brush '
          'model, positive forward')),
    rate=ONE_PER_CROSSING)
ORIENTATION = 'unit quaternion, of which the yaw is used; all zero: none'
PATH = Content('path to follow; replaces the one that is followed', (
    Field('header.stamp', '', 'refused if older than `path_max_age`; zero: its age is counted '
          'from its publication'),
    Field('poses', 'm, -', 'poses of `base_link` in `odom`, whose `header.frame_id` is `odom` or '
          'empty: position (z is ignored) and orientation (' + ORIENTATION + ' given)')),
    rate='on change, transient local')
GOAL_POSE = Content('pose to drive to; replaces the path that is followed', (
    Field('header.stamp', '', 'as in `path`'),
    Field('pose.position', 'm', 'position of `base_link`; z is ignored'),
    Field('pose.orientation', '-', ORIENTATION + ' given, any yaw')),
    rate='on change')
PATH_PROGRESS = Content('progress along the path', (
    QUANTITY_NAMES,
    Field('position', '', 'values; the distances are NaN while no path is followed'),
    Field('velocity', '', 'empty'),
    Field('effort', '', 'empty')), (
    Field('remaining_distance', 'm', 'distance to the end along the path'),
    Field('cross_track_error', 'm', 'distance of the robot from the path, positive to the left'),
    Field('state', '-', '0 idle, 1 following, 2 arrived, 3 stopped, 4 refused; the reason is in '
          'the log and in `/diagnostics`')),
    rate='4 Hz and at each change of the state')
CMD_VEL = Content('commanded velocity of the body; more inputs with `cmd_vel_inputs`', (
    Field('header.stamp', '', 'time of the command; zero: its age is counted from its arrival'),
    Field('twist.linear.x', 'm/s', 'speed, forward'),
    Field('twist.angular.z', 'rad/s', 'yaw rate, counter-clockwise')),
    rate='any; zero duty `cmd_vel_timeout` after the last message')
WHEEL_COMMANDS = Content('set points of the wheel speeds', (
    WHEEL_NAMES,
    Field('position', '', 'empty'),
    Field('velocity', 'rad/s', 'set point, positive rolling forward'),
    Field('effort', '', 'empty')))
MOTOR_COMMANDS = Content('duties of the motors', (
    WHEEL_NAMES,
    Field('position', '', 'empty'),
    Field('velocity', '', 'empty'),
    Field('effort', '-', 'duty in [-1, 1], positive rolling forward')),
    rate='16 Hz, repeated after 0.1 s at the latest')

CONTENTS: dict[str, Content] = {
    'imu/data': IMU, 'wheel_states': WHEEL_STATES, 'tire_samples': TIRE_SAMPLES,
    'tire_battery': TIRE_BATTERY, 'odom': ODOM, 'wheel_slip': WHEEL_SLIP, 'icr': ICR,
    'ground_state': GROUND_STATE, 'tire_friction': TIRE_FRICTION, 'path': PATH,
    'goal_pose': GOAL_POSE, 'path_progress': PATH_PROGRESS, 'cmd_vel': CMD_VEL,
    'wheel_commands': WHEEL_COMMANDS, 'motor_commands': MOTOR_COMMANDS,
    'ground_truth/odom': Content('exact pose and velocity of the simulated robot', ODOM.fields),
    'ground_truth/wheel_slip': Content(
        'exact slip of the simulated wheels; standard deviation 0', WHEEL_SLIP.fields),
    'ground_truth/tire_friction': Content(
        'exact quantities of a patch crossing of the simulated films; standard deviation 0',
        TIRE_FRICTION.fields, TIRE_FRICTION.quantities, ONE_PER_CROSSING),
    'overhead/odom': Content(
        'pose and velocity from an external camera, in the frame `map`; from recordings: no node '
        'publishes it', ODOM.fields),
    'overhead/wheel_slip': Content(
        'slip from an external camera; from recordings: no node publishes it', WHEEL_SLIP.fields),
}
