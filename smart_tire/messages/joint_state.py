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
JointState messages: ``name`` assigns each number to a wheel, film or quantity.

A robot always sends the same names, so their positions are determined once and cached.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import repeat
from math import inf, isfinite, isinf, isnan
from typing import Any, cast, TYPE_CHECKING

from smart_tire.errors import MessageError
from smart_tire.messages.header import (
    bounded, Columns, finite, names_of, not_finite_error, set_joints, stamp_of, stamps_of,
    wheel_of)
from smart_tire.messages.joint_names import LAYOUT_CACHE_SIZE, wheel_layout, WheelLayout
from smart_tire.parameters.robot import JointParams, STANDARD_JOINTS
from smart_tire.samples import (
    Four, four, Friction, FRICTION_QUANTITIES, GROUND_ESTIMATES, GROUND_NUMBERS, GroundState,
    MAX_FILM_VOLTAGE, MAX_WHEEL_ANGLE, MAX_WHEEL_SPEED, MAX_WHEEL_TORQUE, MotorCommand, NAN,
    TireSample, WheelCommand, WHEELS, WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain, UNKNOWN

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

QUANTITIES = frozenset(FRICTION_QUANTITIES)
# Far beyond any tire, ground and robot; the squares and products of filters are finite.
GROUND_RANGES = {
    'stiffness': (1e-2, 1e8), 'friction_coefficient': (1e-4, 10.0),  # N, -
    'rolling_resistance': (-1.0, 1.0), 'lateral_share': (-10.0, 10.0),
    'lateral_stiffness_ratio': (1e-3, 1e3),
    'center_of_mass_x': (-100.0, 100.0), 'center_of_mass_y': (-100.0, 100.0),  # m
    'imu_x': (-100.0, 100.0), 'imu_y': (-100.0, 100.0),
    'motor_friction': (1e-3, 1e3), 'torque_scale': (1e-3, 1e3),
    'stiffness_friction_correlation': (-1.0, 1.0), 'friction_common_sigma': (0.0, inf),
    'change_age_left': (0.0, inf), 'change_age_right': (0.0, inf)}  # s
GROUND_QUANTITIES = tuple(GROUND_RANGES)


def _values(msg: Any, field: str, topic: str) -> list[float]:
    """Return the numbers of ``field``, one per name."""
    values = getattr(msg, field)
    numbers = cast('list[float]', values.tolist() if hasattr(values, 'tolist') else list(values))
    if len(numbers) != len(msg.name):
        raise MessageError(f'{topic}: {field} has {len(numbers)} numbers, '
                           f'expected one for each of {len(msg.name)} names')
    return numbers


@lru_cache(LAYOUT_CACHE_SIZE)
def _wheel_indices(names: tuple[str, ...], topic: str) -> tuple[int, int, int, int]:
    if any(names.count(wheel) != 1 for wheel in WHEELS):
        raise MessageError(f'{topic}: name is {list(names)}, '
                           f'expected each of {", ".join(WHEELS)} once')
    return four(map(names.index, WHEELS))


def _four(msg: Any, field: str, topic: str) -> Four:
    a, b, c, d = _wheel_indices(names_of(msg, topic), topic)
    values = _values(msg, field, topic)
    return values[a], values[b], values[c], values[d]


def wheels_from_msg(msg: Any, topic: str = 'wheel_states', joints: JointParams = STANDARD_JOINTS,
                    *, recognize: bool = True) -> WheelSample:
    """
    Return the wheel sample in a JointState; ``joints`` are the wheels, other joints are ignored.

    The position may be empty or NaN, the effort as well, also of single wheels. Raises
    OtherJointsError if the message has none of the wheels. With ``recognize``, the default
    ``joints`` also match other unambiguous names.
    """
    layout = wheel_layout(names_of(msg, topic), joints, topic, recognize=recognize)
    velocity = wheel_values(msg, 'velocity', layout.signs, layout, topic)
    finite(topic, 'velocity', _measured(velocity, layout))
    bounded(topic, 'velocity', velocity, MAX_WHEEL_SPEED, 'rad/s')
    return WheelSample(stamp_of(msg), velocity, measured_angles(msg, layout, topic),
                       torques(msg, layout, topic))


def wheel_values(msg: Any, field: str, factors: Four, layout: WheelLayout, topic: str) -> Four:
    """Return the numbers of the wheels times ``factors``; NaN for wheels without a joint."""
    values = _values(msg, field, topic)
    return four([NAN if index is None else factor * values[index]
                 for index, factor in zip(layout.indices, factors)])


def _measured(values: Four, layout: WheelLayout) -> list[float]:
    """Return those of ``values`` whose wheel has a joint."""
    return [value for value, index in zip(values, layout.indices) if index is not None]


def measured_angles(msg: Any, layout: WheelLayout, topic: str) -> Four | None:
    """Return the angles of the wheels; None if one of those with a joint is not measured."""
    if not len(msg.position):
        return None
    angles = wheel_values(msg, 'position', layout.signs, layout, topic)
    measured = _measured(angles, layout)
    if any(map(isnan, measured)):
        return None
    bounded(topic, 'position', finite(topic, 'position', measured), MAX_WHEEL_ANGLE, 'rad')
    return angles


def torques(msg: Any, layout: WheelLayout, topic: str) -> Four | None:
    """Return the motor torques, NaN where not measured; None if none was measured."""
    if not len(msg.effort):
        return None
    values = wheel_values(msg, 'effort', layout.torque_factors, layout, topic)
    if any(map(isinf, values)):
        raise not_finite_error(topic, 'effort', values)
    bounded(topic, 'effort', values, MAX_WHEEL_TORQUE, 'N m')
    return None if all(map(isnan, values)) else values


def wheels_to_msg(msg: Any, sample: WheelSample) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_joints(msg, sample.stamp_ns, 'base_link', WHEELS, position=sample.position or (),
                      velocity=sample.velocity, effort=sample.effort or ())


@lru_cache(LAYOUT_CACHE_SIZE)
def film_names(wheel: str, count: int) -> tuple[str, ...]:
    """Return the joint names of the first ``count`` films of ``wheel``."""
    return tuple(f'{wheel}_pvdf_{film}' for film in range(1, count + 1))


@lru_cache(LAYOUT_CACHE_SIZE)
def film_indices(names: tuple[str, ...], wheel: str) -> tuple[int, ...]:
    ours = [name for name in names if name.startswith(f'{wheel}_pvdf_')]
    if not ours or sorted(ours) != sorted(film_names(wheel, len(ours))):
        raise MessageError(f'tire_samples: name is {list(names)}, '
                           f'expected {wheel}_pvdf_1, {wheel}_pvdf_2 ... once each')
    return tuple(names.index(name) for name in film_names(wheel, len(ours)))


def tire_from_msg(msg: Any) -> TireSample:
    """Return the sample in a JointState."""
    wheel = wheel_of(msg, 'tire_samples')
    indices = film_indices(names_of(msg, 'tire_samples'), wheel)
    values = _values(msg, 'position', 'tire_samples')
    volts = tuple([values[index] for index in indices])
    return TireSample(stamp_of(msg), wheel, bounded(
        'tire_samples', 'position', finite('tire_samples', 'position', volts),
        MAX_FILM_VOLTAGE, 'V'))


def tires_from_columns(msg: Any, columns: Columns) -> tuple[list[TireSample], NDArray[np.bool_]]:
    """
    Return the samples in JointStates of a layout as ``tire_from_msg`` does, and which are valid.

    ``msg`` has their strings. Raises MessageError if these are invalid.
    """
    import numpy as np
    wheel = wheel_of(msg, 'tire_samples')
    indices = film_indices(names_of(msg, 'tire_samples'), wheel)
    (stamps, valid), values = stamps_of(columns), columns['position']
    if values.shape[1] != len(msg.name):
        return [], np.zeros(len(values), dtype=bool)
    volts = values[:, indices]
    valid &= (np.abs(volts) <= MAX_FILM_VOLTAGE).all(axis=1)
    return list(map(TireSample, stamps.tolist(), repeat(wheel), zip(*volts.T.tolist()))), valid


def tire_to_msg(msg: Any, sample: TireSample) -> Any:
    """Write ``sample`` into a JointState and return it."""
    names = film_names(sample.wheel, len(sample.volts))
    return set_joints(msg, sample.stamp_ns, sample.wheel, names, position=sample.volts)


def wheel_slip_from_msg(msg: Any, topic: str = 'wheel_slip') -> WheelSlip:
    """Return the wheel slip in a JointState; a ratio may be NaN, a sigma infinite."""
    ratio, sigma = _four(msg, 'position', topic), _four(msg, 'effort', topic)
    if any(map(isnan, sigma)):
        raise MessageError(f'{topic}: effort is {list(sigma)}, expected a sigma for each wheel')
    velocity = _four(msg, 'velocity', topic)
    if any(not isfinite(speed) and not (isnan(speed) and isnan(slip))
           for speed, slip in zip(velocity, ratio)):  # both are NaN of a wheel without encoder
        raise not_finite_error(topic, 'velocity', velocity)
    return WheelSlip(stamp_of(msg), ratio, velocity, sigma)


def wheel_slip_to_msg(msg: Any, sample: WheelSlip) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_joints(msg, sample.stamp_ns, 'base_link', WHEELS, position=sample.ratio,
                      velocity=sample.slip_velocity, effort=sample.sigma)


def wheel_slip_numbers(sample: WheelSlip) -> tuple[float, ...]:
    """Return all doubles of the message of ``sample``, in the order of their bytes."""
    return sample.ratio + sample.slip_velocity + sample.sigma


def ground_state_from_msg(msg: Any) -> GroundState:
    """
    Return the ground state in a JointState; a sigma may be infinite.

    Missing quantities except the stiffness are unknown, others are ignored.
    """
    names = names_of(msg, 'ground_state')
    if names.count('stiffness') != 1 or any(names.count(name) > 1 for name in GROUND_QUANTITIES):
        raise MessageError(f'ground_state: name is {list(names)}, '
                           'expected stiffness and others once')
    values, sigmas = (dict(zip(names, _values(msg, field, 'ground_state')))
                      for field in ('position', 'effort'))
    found: dict[str, Any] = {
        name: bounded_estimate('ground_state', name, values[name], sigmas[name], limits)
        for name, limits in GROUND_RANGES.items() if name in values}
    for name, default in GROUND_NUMBERS.items():
        value = found.get(name, UNKNOWN).value
        found[name] = default if isnan(value) else value
    return GroundState(stamp_of(msg), **found)


def bounded_estimate(topic: str, name: str, value: float, sigma: float,
                     limits: tuple[float, float]) -> Uncertain:
    """Return an estimate, NaN, of infinite sigma or within ``limits``; else a MessageError."""
    low, high = limits
    if value < low or value > high:
        raise MessageError(f'{topic}: position of {name} is {value:g}, '
                           f'expected {low:g} to {high:g}')
    if not 0.0 <= sigma <= high and sigma != inf:
        raise MessageError(f'{topic}: effort of {name} is {sigma:g}, expected a sigma of 0 '
                           f'to {high:g}, or inf')
    return Uncertain(value, sigma)


def ground_state_to_msg(msg: Any, sample: GroundState) -> Any:
    """Write ``sample`` into a JointState and return it."""
    estimates = [*(getattr(sample, name) for name in GROUND_ESTIMATES),
                 *(Uncertain(getattr(sample, name), 0.0) for name in GROUND_NUMBERS)]
    return set_quantities(msg, sample.stamp_ns, 'base_link', GROUND_QUANTITIES, estimates)


def set_quantities(msg: Any, stamp_ns: int, frame: str, names: Sequence[str],
                   quantities: Sequence[Uncertain]) -> Any:
    """Write estimates with their names into a JointState and return it."""
    return set_joints(msg, stamp_ns, frame, names, position=[one.value for one in quantities],
                      effort=[one.sigma for one in quantities])


def friction_from_msg(msg: Any, topic: str = 'tire_friction') -> Friction:
    """Return the friction in a JointState; missing quantities are NaN with infinite sigma."""
    names = names_of(msg, topic)
    values, sigmas = _values(msg, 'position', topic), _values(msg, 'effort', topic)
    quantities = {name: Uncertain(value, sigma)
                  for name, value, sigma in zip(names, values, sigmas) if name in QUANTITIES}
    if QUANTITIES.isdisjoint(names):
        raise MessageError(f'{topic}: name is {list(names)}, '
                           f'expected {FRICTION_QUANTITIES[0]} and others')
    return Friction(stamp_of(msg), wheel_of(msg, topic), **quantities)


def friction_to_msg(msg: Any, sample: Friction) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_quantities(msg, sample.stamp_ns, sample.wheel, FRICTION_QUANTITIES,
                          [sample.quantity(name) for name in FRICTION_QUANTITIES])


def wheel_command_from_msg(msg: Any) -> WheelCommand:
    """Return the wheel speed set points in a JointState."""
    topic = 'wheel_commands'
    return WheelCommand(stamp_of(msg), finite(topic, 'velocity', _four(msg, 'velocity', topic)))


def wheel_command_to_msg(msg: Any, sample: WheelCommand) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_joints(msg, sample.stamp_ns, 'base_link', WHEELS, velocity=sample.velocity)


def motor_command_from_msg(msg: Any) -> MotorCommand:
    """Return the duties [-1, 1] in a JointState."""
    topic = 'motor_commands'
    duty = finite(topic, 'effort', _four(msg, 'effort', topic))
    return MotorCommand(stamp_of(msg), bounded(topic, 'effort', duty, 1.0, '(full duty)'))


def motor_command_to_msg(msg: Any, sample: MotorCommand) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_joints(msg, sample.stamp_ns, 'base_link', WHEELS, effort=sample.duty)
