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
Messages of smart_tire_msgs: what JointState messages carry by name, in fields of that name.

JointState is what every tool opens, but its fields have other meanings and units. ``FORMS`` says
for each class of samples where the numbers of its JointState are, so that both are read by the
same function, with the same checks. docs/topics_page.py writes ``smart_tire_msgs/msg/`` from this
table and the texts of ``topics.yaml``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from smart_tire.errors import MessageError
from smart_tire.messages.header import (
    bounded, finite, names_of, set_header, stamp_of, wheel_of)
from smart_tire.messages.joint_state import film_indices, film_names
from smart_tire.messages.path import PROGRESS_NAMES
from smart_tire.samples import (
    FilmDeflection, Friction, FRICTION_QUANTITIES, GROUND_ESTIMATES, GROUND_NUMBERS, GroundState,
    MAX_FILM_VOLTAGE, NS_PER_S, PathProgress, TireSamples, WHEELS, WheelSlip)

PACKAGE = 'smart_tire_msgs'
SUFFIX = '/typed'  # of the topics
ESTIMATE = f'{PACKAGE}/msg/Estimate'
BATCH_RATE = 25.0  # Hz, of a sensor node with 16 samples at 400 Hz in a batch
NUMBER, NUMBERS, NAMES = 'float64', 'float64[]', 'string[]'


@dataclass(frozen=True)
class Form:
    """
    A message type, by its fields after the header: name -> type of the field.

    ``lists`` are its lists with a number for each name -> that of a JointState. Of its other
    fields, an estimate has value and standard deviation, which a JointState has in ``position``
    and ``effort``; a number stands in ``position``. All are attributes of the sample, too.
    """

    type: str  # noqa: A003
    fields: Mapping[str, str]
    lists: Mapping[str, str] = field(default_factory=dict)
    constants: tuple[str, ...] = ()  # names of 0, 1, ... of the last field

    def fill(self, msg: Any, sample: Any, frame: str) -> Any:
        """Write ``sample`` into a message and return it; ``frame`` '': that of its wheel."""
        set_header(msg, sample.stamp_ns, frame or sample.wheel)
        for name, kind in self.fields.items():
            if kind == NAMES:
                msg.name = WHEELS
            elif kind == ESTIMATE:
                part = getattr(msg, name)
                part.value, part.sigma = getattr(sample, name)
            else:
                setattr(msg, name, getattr(sample, name))
        return msg

    def joints(self, msg: Any) -> Any:
        """Return the content of a message as a JointState."""
        if self.lists:
            return SimpleNamespace(header=msg.header, name=msg.name, **{
                joints: getattr(msg, name) for name, joints in self.lists.items()})
        parts = [getattr(msg, name) for name in self.fields]
        position, effort = zip(*(
            (part.value, part.sigma) if kind == ESTIMATE else (part, 0.0)
            for part, kind in zip(parts, self.fields.values())))
        return SimpleNamespace(header=msg.header, name=tuple(self.fields), position=position,
                               effort=effort)


FORMS: dict[type[Any], Form] = {
    WheelSlip: Form(f'{PACKAGE}/msg/WheelSlip', {
        'name': NAMES, 'ratio': NUMBERS, 'sigma': NUMBERS, 'slip_velocity': NUMBERS},
        {'ratio': 'position', 'sigma': 'effort', 'slip_velocity': 'velocity'}),
    Friction: Form(f'{PACKAGE}/msg/TireFriction', dict.fromkeys(FRICTION_QUANTITIES, ESTIMATE)),
    FilmDeflection: Form(f'{PACKAGE}/msg/FilmDeflection', {'deflection': ESTIMATE}),
    GroundState: Form(f'{PACKAGE}/msg/GroundState', {
        **dict.fromkeys(GROUND_ESTIMATES, ESTIMATE), **dict.fromkeys(GROUND_NUMBERS, NUMBER)}),
    PathProgress: Form(
        f'{PACKAGE}/msg/PathProgress', {**dict.fromkeys(PROGRESS_NAMES, NUMBER), 'state': 'uint8'},
        constants=('IDLE', 'FOLLOWING', 'ARRIVED', 'STOPPED', 'REFUSED')),
}
BATCH = Form(f'{PACKAGE}/msg/TireSamples', {
    'name': NAMES, 'sample_period': NUMBER, 'volts': NUMBERS, 'saturated': 'bool'})


def definitions() -> dict[str, str]:
    """Return message type -> its definition, without comments."""
    found = {ESTIMATE: f'{NUMBER} value\n{NUMBER} sigma\n'}
    for form in (*FORMS.values(), BATCH):
        kinds = {name: kind.replace('/msg/', '/') for name, kind in form.fields.items()}
        constants = [f'{[*kinds.values()][-1]} {name}={value}'
                     for value, name in enumerate(form.constants)]
        found[form.type] = '\n'.join(('std_msgs/Header header', *constants, *(
            f'{kind} {name}' for name, kind in kinds.items()), ''))
    return found


def samples_to_msg(msg: Any, batch: TireSamples) -> Any:
    """Write ``batch`` into a TireSamples message and return it."""
    set_header(msg, batch.stamp_ns, batch.wheel)
    msg.name = film_names(batch.wheel, len(batch.volts[0]))
    msg.sample_period = batch.period_ns / NS_PER_S
    msg.volts = [number for film in zip(*batch.volts) for number in film]
    msg.saturated = batch.saturated
    return msg


def samples_from_msg(msg: Any) -> TireSamples:
    """Return the batch in a TireSamples message."""
    topic = 'tire_samples' + SUFFIX
    wheel, stamp_ns, films = wheel_of(msg, topic), stamp_of(msg), len(msg.name)
    order = film_indices(names_of(msg, topic), wheel)
    numbers = bounded(topic, 'volts', finite(topic, 'volts', [
        float(number) for number in msg.volts]), MAX_FILM_VOLTAGE, 'V')
    count, rest = divmod(len(numbers), films)
    if rest or not count:
        raise MessageError(f'{topic}: volts has {len(numbers)} numbers, expected as many for each '
                           f'of {films} films')
    (period,) = finite(topic, 'sample_period', (float(msg.sample_period),))
    period_ns = round(period * NS_PER_S)
    if not (stamp_ns and 0 < period_ns <= NS_PER_S):
        raise MessageError(f'{topic}: header.stamp is {stamp_ns} ns, sample_period {period:g} s, '
                           'expected a time and 1e-9 to 1 s')
    return TireSamples(stamp_ns, wheel, period_ns, tuple(zip(*(
        numbers[index * count:(index + 1) * count] for index in order))), bool(msg.saturated))
