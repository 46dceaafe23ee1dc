# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages with vectors, quaternions and covariances: odometry, IMU, ICR, commands, battery."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import isfinite, isnan, nan
from typing import Any, TYPE_CHECKING

from smart_tire.errors import MessageError
from smart_tire.messages.header import (
    bounded, Columns, finite, not_finite_error, set_header, stamp_of, stamps_of, wheel_of)
from smart_tire.samples import (
    BatterySample, Icr, ImuSample, MAX_ANGULAR_RATE, MAX_POSITION, MAX_SPECIFIC_FORCE, MAX_SPEED,
    Odometry, Vector3, VelocityCommand)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

NOT_MEASURED = -1.0  # first element of a covariance if the quantity is not measured (REP-145)
NOT_MEASURED_COVARIANCE = (NOT_MEASURED, *[0.0] * 8)
UNKNOWN_COVARIANCE = (0.0,) * 9  # measured, covariance unknown (REP-145)


def _vector(vector: Any, field: str, topic: str) -> Vector3:
    return finite(topic, field, (vector.x, vector.y, vector.z))


def _bounded_vector(topic: str, field: str, vector: Any, limit: float, unit: str) -> Vector3:
    return bounded(topic, field, _vector(vector, field, topic), limit, unit)


def _quaternion(rotation: Any, field: str, topic: str) -> tuple[float, float, float, float]:
    return finite(topic, field, (rotation.x, rotation.y, rotation.z, rotation.w))


def _covariance(matrix: Any, field: str, topic: str) -> tuple[float, ...]:
    numbers = tuple(matrix.tolist() if hasattr(matrix, 'tolist') else matrix)
    if len(numbers) != 36 or not all(map(isfinite, numbers)):
        raise not_finite_error(topic, field, numbers)
    return numbers


def _isotropic(sigma: float) -> tuple[float, ...]:
    """Return the covariance (9 numbers) of a vector with ``sigma`` on each axis."""
    variance = sigma ** 2
    return (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance)


def _set_vector(target: Any, values: Sequence[float]) -> None:
    target.x, target.y, target.z = values


def _set_quaternion(target: Any, values: Sequence[float]) -> None:
    target.x, target.y, target.z, target.w = values


def imu_from_msg(msg: Any, contradictions: Counter[str] | None = None) -> ImuSample:
    """
    Return the sample in an Imu; its orientation is None if not measured, NaN or all zero.

    Raises MessageError if the message says that rate or acceleration is not measured: by zeros
    and a covariance of -1. Other values with this covariance are used, and their fields counted in
    ``contradictions``.
    """
    return ImuSample(
        stamp_of(msg),
        _measured(msg, 'linear_acceleration', MAX_SPECIFIC_FORCE, 'm/s2', contradictions),
        _measured(msg, 'angular_velocity', MAX_ANGULAR_RATE, 'rad/s', contradictions),
        _orientation(msg))


def _measured(msg: Any, field: str, limit: float, unit: str,
              contradictions: Counter[str] | None) -> Vector3:
    vector = _bounded_vector('imu/data', field, getattr(msg, field), limit, unit)
    if getattr(msg, f'{field}_covariance')[0] == NOT_MEASURED:
        if not any(vector):
            raise MessageError(f'imu/data: {field} is not measured: zeros, and covariance -1 '
                               '(REP-145)')
        if contradictions is not None:  # some drivers send -1 with measurements
            contradictions[field] += 1
    return vector


def _orientation(msg: Any) -> tuple[float, float, float, float] | None:
    given = msg.orientation
    xyzw = given.x, given.y, given.z, given.w
    if msg.orientation_covariance[0] == NOT_MEASURED or any(map(isnan, xyzw)) or not any(xyzw):
        return None
    return finite('imu/data', 'orientation', xyzw)


def imus_from_columns(msg: Any, columns: Columns) -> tuple[list[ImuSample], NDArray[np.bool_]]:
    """
    Return the samples in n Imus of a layout as ``imu_from_msg`` does, and which are plainly valid.

    Not those that contradict themselves: they are to be read one by one.
    """
    import numpy as np
    stamps, valid = stamps_of(columns)
    for field, limit in (('linear_acceleration', MAX_SPECIFIC_FORCE),
                         ('angular_velocity', MAX_ANGULAR_RATE)):
        valid &= (np.abs(columns[field]) <= limit).all(axis=1) & (
            columns[f'{field}_covariance'][:, 0] != NOT_MEASURED)
    turned = columns['orientation']
    given = ((columns['orientation_covariance'][:, 0] != NOT_MEASURED)
             & ~np.isnan(turned).any(axis=1) & turned.any(axis=1))
    valid &= ~given | np.isfinite(turned).all(axis=1)
    vectors = (zip(*columns[field].T.tolist()) for field in (
        'linear_acceleration', 'angular_velocity'))
    orientations = [one if known else None for one, known in zip(
        zip(*turned.T.tolist()), given.tolist())]
    return list(map(ImuSample, stamps.tolist(), *vectors, orientations)), valid


def imu_to_msg(msg: Any, sample: ImuSample, gyro_noise: float = 0.0, accel_noise: float = 0.0
               ) -> Any:
    """
    Write ``sample`` into an Imu and return it.

    ``gyro_noise`` [rad/s] and ``accel_noise`` [m/s2] are the standard deviations of the noise of
    one sample, on each axis; 0 is unknown (REP-145). A bias is no noise: it is not part of them.
    """
    set_header(msg, sample.stamp_ns, 'imu_link')
    _set_vector(msg.linear_acceleration, sample.acceleration)
    _set_vector(msg.angular_velocity, sample.rate)
    msg.orientation_covariance = (
        NOT_MEASURED_COVARIANCE if sample.orientation is None else UNKNOWN_COVARIANCE)
    msg.angular_velocity_covariance = _isotropic(gyro_noise)
    msg.linear_acceleration_covariance = _isotropic(accel_noise)
    _set_quaternion(msg.orientation, sample.orientation or (0.0, 0.0, 0.0, 1.0))
    return msg


def odometry_from_msg(msg: Any, topic: str = 'odom') -> Odometry:
    """Return the pose and twist in an Odometry."""
    pose, twist = msg.pose.pose, msg.twist.twist
    return Odometry(
        stamp_of(msg),
        _bounded_vector(topic, 'pose.pose.position', pose.position, MAX_POSITION, 'm'),
        _quaternion(pose.orientation, 'pose.pose.orientation', topic),
        _bounded_vector(topic, 'twist.twist.linear', twist.linear, MAX_SPEED, 'm/s'),
        _bounded_vector(topic, 'twist.twist.angular', twist.angular, MAX_ANGULAR_RATE, 'rad/s'),
        _covariance(msg.pose.covariance, 'pose.covariance', topic),
        _covariance(msg.twist.covariance, 'twist.covariance', topic))


def odometry_to_msg(msg: Any, sample: Odometry, frame: str = 'odom') -> Any:
    """Write ``sample`` into an Odometry and return it."""
    set_header(msg, sample.stamp_ns, frame)
    msg.child_frame_id = 'base_link'
    _set_vector(msg.pose.pose.position, sample.position)
    _set_quaternion(msg.pose.pose.orientation, sample.orientation)
    _set_vector(msg.twist.twist.linear, sample.linear)
    _set_vector(msg.twist.twist.angular, sample.angular)
    msg.pose.covariance = sample.pose_covariance
    msg.twist.covariance = sample.twist_covariance
    return msg


def odometry_numbers(sample: Odometry) -> tuple[float, ...]:
    """Return all doubles of the message of ``sample``, in the order of their bytes."""
    return (*sample.position, *sample.orientation, *sample.pose_covariance, *sample.linear,
            *sample.angular, *sample.twist_covariance)


def transform_to_msg(msg: Any, sample: Odometry) -> Any:
    """Write the pose of ``sample`` into a TransformStamped, for /tf, and return it."""
    return _fill_transform(msg, sample.stamp_ns, ('odom', 'base_link'), sample.position,
                           sample.orientation)


def imu_mounting_to_msg(msg: Any, stamp_ns: int, position: Sequence[float],
                        orientation: Sequence[float]) -> Any:
    """
    Write the pose of ``imu_link`` in ``base_link`` into a TransformStamped, for /tf_static.

    ``position`` is in m, ``orientation`` a unit quaternion (x, y, z, w). Returns the message.
    """
    return _fill_transform(msg, stamp_ns, ('base_link', 'imu_link'), position, orientation)


def _fill_transform(msg: Any, stamp_ns: int, frames: tuple[str, str], position: Sequence[float],
                    orientation: Sequence[float]) -> Any:
    set_header(msg, stamp_ns, frames[0])
    msg.child_frame_id = frames[1]
    _set_vector(msg.transform.translation, position)
    _set_quaternion(msg.transform.rotation, orientation)
    return msg


def icr_from_msg(msg: Any) -> Icr:
    """Return the instantaneous center of rotation in a PointStamped."""
    x, y, _ = _vector(msg.point, 'point', 'icr')
    return Icr(stamp_of(msg), x, y)


def icr_to_msg(msg: Any, sample: Icr) -> Any:
    """Write ``sample`` into a PointStamped and return it."""
    set_header(msg, sample.stamp_ns, 'base_link')
    _set_vector(msg.point, (sample.x, sample.y, 0.0))
    return msg


def icr_numbers(sample: Icr) -> tuple[float, ...]:
    """Return all doubles of the message of ``sample``, in the order of their bytes."""
    return sample.x, sample.y, 0.0


def velocity_from_msg(msg: Any) -> VelocityCommand:
    """Return the command in a TwistStamped; only ``linear.x`` and ``angular.z`` are used."""
    return _velocity(msg.twist, stamp_of(msg), 'twist.')


def velocity_from_twist(msg: Any) -> VelocityCommand:
    """Return the command in a Twist, which has no timestamp: zero."""
    return _velocity(msg, 0, '')


def _velocity(twist: Any, stamp_ns: int, prefix: str) -> VelocityCommand:
    linear = _bounded_vector('cmd_vel', f'{prefix}linear', twist.linear, MAX_SPEED, 'm/s')
    angular = _bounded_vector(
        'cmd_vel', f'{prefix}angular', twist.angular, MAX_ANGULAR_RATE, 'rad/s')
    return VelocityCommand(stamp_ns, linear[0], angular[2])


def velocity_to_msg(msg: Any, sample: VelocityCommand) -> Any:
    """Write ``sample`` into a TwistStamped and return it."""
    set_header(msg, sample.stamp_ns, 'base_link')
    msg.twist.linear.x, msg.twist.angular.z = sample.v_x, sample.yaw_rate
    return msg


def battery_from_msg(msg: Any) -> BatterySample:
    """Return the state in a BatteryState."""
    (volts,) = finite('tire_battery', 'voltage', (msg.voltage,))
    return BatterySample(stamp_of(msg), wheel_of(msg, 'tire_battery'), volts)


def battery_to_msg(msg: Any, sample: BatterySample) -> Any:
    """Write ``sample`` into a BatteryState and return it; values not measured are NaN."""
    set_header(msg, sample.stamp_ns, sample.wheel)
    msg.voltage = sample.volts
    msg.temperature = msg.current = msg.charge = msg.capacity = nan
    msg.design_capacity = msg.percentage = nan
    msg.present = True
    msg.location = sample.wheel
    return msg
