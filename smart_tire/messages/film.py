# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Messages of a buckling film: charge and deflection as JointState, temperature."""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

from smart_tire.errors import MessageError
from smart_tire.messages.header import bounded, finite, names_of, set_header, set_joints, stamp_of
from smart_tire.messages.joint_state import bounded_estimate, set_quantities
from smart_tire.samples import FilmCharge, FilmDeflection, FilmTemperature

FRAME = 'film_link'
CHARGE_NAMES = ('charge', 'saturated', 'discharged')
DEFLECTION_NAMES = ('deflection',)
MAX_CHARGE = 1e-3          # C, far beyond any film
DEFLECTIONS = -100.0, 100.0  # m, far beyond any film
TEMPERATURES = -273.15, 1000.0  # degree Celsius


def charge_from_msg(msg: Any) -> FilmCharge:
    """Return the charge in a JointState; the flags may be missing."""
    names = names_of(msg, 'film_charge')
    if names.count('charge') != 1 or len(msg.position) != len(names):
        raise MessageError(f'film_charge: name is {list(names)} with {len(msg.position)} '
                           'positions, expected charge once, and as many numbers as names')
    values = dict(zip(names, finite('film_charge', 'position', list(msg.position))))
    bounded('film_charge', 'charge', (values['charge'],), MAX_CHARGE, 'C')
    return FilmCharge(stamp_of(msg), values['charge'], *(
        bool(values.get(name, 0.0)) for name in CHARGE_NAMES[1:]))


def charge_to_msg(msg: Any, sample: FilmCharge) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_joints(msg, sample.stamp_ns, FRAME, CHARGE_NAMES, position=(
        sample.charge, float(sample.saturated), float(sample.discharged)))


def temperature_from_msg(msg: Any) -> FilmTemperature:
    """Return the temperature in a Temperature; a variance of 0 is unknown."""
    value, variance = msg.temperature, msg.variance
    if not (TEMPERATURES[0] <= value <= TEMPERATURES[1] and 0.0 <= variance < inf):
        raise MessageError(f'film_temperature: temperature {value}, variance {variance}, expected '
                           f'{TEMPERATURES[0]:g} to {TEMPERATURES[1]:g} degree Celsius, and a '
                           'variance that is finite and not negative')
    return FilmTemperature(stamp_of(msg), value, sqrt(variance))


def temperature_to_msg(msg: Any, sample: FilmTemperature) -> Any:
    """Write ``sample`` into a Temperature and return it."""
    set_header(msg, sample.stamp_ns, FRAME)
    msg.temperature, msg.variance = sample.value, sample.sigma**2
    return msg


def deflection_from_msg(msg: Any, topic: str = 'film_deflection') -> FilmDeflection:
    """Return the deflection in a JointState; NaN with an infinite sigma is unknown."""
    if names_of(msg, topic) != DEFLECTION_NAMES or not len(msg.position) == len(msg.effort) == 1:
        raise MessageError(f'{topic}: name is {list(msg.name)}, expected deflection with one '
                           'position and one effort')
    return FilmDeflection(stamp_of(msg), bounded_estimate(
        topic, *DEFLECTION_NAMES, msg.position[0], msg.effort[0], DEFLECTIONS))


def deflection_to_msg(msg: Any, sample: FilmDeflection) -> Any:
    """Write ``sample`` into a JointState and return it."""
    return set_quantities(msg, sample.stamp_ns, FRAME, DEFLECTION_NAMES, (sample.deflection,))
