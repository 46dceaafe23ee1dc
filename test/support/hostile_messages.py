# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages of a drive to attack a node with, and changes of any of their fields."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from copy import deepcopy
from functools import lru_cache
import math
from random import Random
import re
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.parameters import SimulatorParams
from smart_tire.samples import (
    Friction, GoalPose, GroundState, NS_PER_S, PlannedPath, VelocityCommand)
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import Uncertain

EPOCH_NS = 1_700_000_000 * NS_PER_S  # of the drive
HOSTILE = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e30, -1e9, 5e-324, 0.0)
RANGES = {f'{sign}int{bits}': ((0, 2**bits - 1) if sign else (-2**(bits - 1), 2**(bits - 1) - 1))
          for sign in ('', 'u') for bits in (8, 16, 32, 64)}
TEXTS = ('', 'x', 'odom', 'front_left', 'front_right', '/', 'x' * 300, '\n', 'r\u00e4der')
SHIFTS = (1, 10**6, 10**8, NS_PER_S, 100 * NS_PER_S, 10**17)  # ns, of a timestamp
SPEEDS = [(1.0, 0.0, 0.0), (1.5, 60.0, 60.0), (3.5, 80.0, 40.0), (5.0, 0.0, 0.0),
          (6.0, 40.0, 60.0)]  # s, rpm
SECONDS = 8.0


def ground(stamp_ns: int) -> GroundState:
    """Return a state of the ground."""
    return GroundState(stamp_ns, Uncertain(50.0, 5.0), *(
        Uncertain(value, sigma) for value, sigma in (
            (0.4, 0.1), (0.02, 0.01), (0.5, 0.2), (0.8, 0.2), (0.0, 0.005), (0.0, 0.005),
            (0.05, 0.01), (0.02, 0.01), (1.0, 0.3), (1.0, 0.05))))


OTHERS: dict[str, tuple[Any, float]] = {  # sample of a stamp, and the period of its topic [s]
    'ground_state': (ground, 0.05),
    'path': (lambda ns: PlannedPath(ns, 'odom', ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0))), 0.05),
    'goal_pose': (lambda ns: GoalPose(ns, 'odom', (4.0, 0.0, 0.0)), 0.05),
    'cmd_vel': (lambda ns: VelocityCommand(ns, 0.4, 0.1), 0.05),
    'tire_friction': (lambda ns: Friction(
        ns, 'front_right', Uncertain(0.4, 0.1), normal_load=Uncertain(26.0, 1.0),
        stiffness=Uncertain(50.0, 5.0)), 0.05),
}


@lru_cache
def drive() -> list[tuple[int, str, Any]]:
    """Return stamp, topic and message of a drive, with those of ``OTHERS``."""
    found = [(ns, topic.removeprefix('ground_truth/'), sample) for ns, topic, sample in
             simulate(SimulatorParams(seed=1), SPEEDS, SECONDS)]
    for topic, (sample_at, period) in OTHERS.items():
        stamps = (EPOCH_NS + round(i * period * NS_PER_S) for i in range(round(SECONDS / period)))
        found += [(ns, topic, sample_at(ns)) for ns in stamps]
    return [(ns, topic, received(TOPICS[topic].to_msg(
        message_class(TOPICS[topic].type)(), sample)))
            for ns, topic, sample in sorted(found, key=lambda event: event[0])]


def received(msg: Any) -> Any:
    """Return a message as a subscriber gets it, with lists and arrays that can be changed."""
    return deserialize_message(serialize_message(msg), type(msg))


def places(msg: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of each number in a message: attributes and indices."""
    if hasattr(msg, 'get_fields_and_field_types'):
        for name in msg.get_fields_and_field_types():
            yield from places(getattr(msg, name), (*path, name))
    elif isinstance(msg, float):
        yield path
    elif not isinstance(msg, (str, int)):
        for i, item in enumerate(msg):
            yield from places(item, (*path, i))


def part_of(msg: Any, path: tuple[Any, ...]) -> Any:
    """Return the part of a message at a place."""
    for part in path:
        msg = msg[part] if isinstance(part, int) else getattr(msg, part)
    return msg


def with_number(msg: Any, path: tuple[Any, ...], number: float) -> Any:
    """Return a copy of a message with another number at a place."""
    put(msg := deepcopy(msg), path, number)
    return msg


def fields(msg: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], str]]:
    """Yield path and type of each field of a message, of messages in it, and of each item."""
    for name, kind in msg.get_fields_and_field_types().items():
        value, place = getattr(msg, name), (*path, name)
        if hasattr(value, 'get_fields_and_field_types'):
            yield from fields(value, place)
            continue
        yield place, kind
        if '[' in kind or kind.startswith('sequence'):
            for i, item in enumerate(value):
                if hasattr(item, 'get_fields_and_field_types'):
                    yield from fields(item, (*place, i))
                else:
                    yield (*place, i), re.split('[<>,[]', kind.removeprefix('sequence<'))[0]


def changed_message(rng: Random, msg: Any) -> Any:
    """Return a copy of a message with one or two fields changed: numbers, lengths, names."""
    msg = deepcopy(msg)
    for _ in range(rng.choice((1, 1, 2))):
        path, kind = rng.choice(list(fields(msg)))
        value = part_of(msg, path)
        if kind in ('float', 'double'):
            new: Any = rng.choice((*HOSTILE, -value, value * 10.0**rng.randint(-12, 12),
                                   math.ldexp(rng.uniform(-1.0, 1.0), rng.randint(-1073, 1023))))
            if kind == 'float' and math.isfinite(new):
                new = max(-3e38, min(new, 3e38))
        elif kind == 'boolean':
            new = not value
        elif kind in RANGES:
            low, high = RANGES[kind]
            new = min(max(rng.choice((low, high, 0, value + rng.choice((-1, 1)) * rng.choice(
                SHIFTS))), low), high)
        elif kind == 'string':
            others = [part_of(msg, other) for other, its in fields(msg) if its == 'string']
            new = rng.choice((*TEXTS, *others))
        elif kind.startswith('sequence'):
            items = list(value)
            new = rng.choice((items[:-1], [], items * 2, items[:1] * 70, items[::-1], items[1:]))
            new = array(value.typecode, new) if isinstance(value, array) else new
        else:
            continue  # an array of fixed length, which Python does not change
        put(msg, path, new)
    return msg


def put(msg: Any, path: tuple[Any, ...], value: Any) -> None:
    """Change a message at a place."""
    owner = part_of(msg, path[:-1])
    if isinstance(path[-1], int):
        owner[path[-1]] = value
    else:
        setattr(owner, path[-1], value)
