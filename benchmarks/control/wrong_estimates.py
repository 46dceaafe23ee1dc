# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wrong estimates of friction and motion, in place of the right ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
import math

from smart_tire.samples import GroundState, Odometry, Sample
from smart_tire.uncertain import Uncertain

LOAD = 26.7  # N, of a wheel of the robot
Fault = Callable[[Iterable[Sample]], Iterator[Sample]]


def wrong_friction(estimates: Iterable[Sample], *, mu: float, critical: float,
                   sigma: float = 1e-3) -> Iterator[Sample]:
    """Yield ``estimates`` with this friction and critical slip instead of the estimated ones."""
    stiffness = 3.0 * mu * LOAD / critical  # N
    for one in estimates:
        if isinstance(one, GroundState):
            continue
        yield one
        if isinstance(one, Odometry):
            yield GroundState(one.stamp_ns, Uncertain(stiffness, sigma * stiffness),
                              Uncertain(mu, sigma))


def wrong_speed(estimates: Iterable[Sample], *, scale: float = 1.0, offset: float = 0.0) -> (
        Iterator[Sample]):
    """Yield ``estimates`` with an error of the forward speed [m/s]."""
    for one in estimates:
        if isinstance(one, Odometry):
            v_x, v_y, v_z = one.linear
            one = replace(one, linear=(scale * v_x + offset, v_y, v_z))
        yield one


FAULTS: dict[str, Fault] = {
    '': iter,
    'friction 1.0': partial(wrong_friction, mu=1.0, critical=1.5),
    'friction 1.0 and stiff': partial(wrong_friction, mu=1.0, critical=0.1),
    'friction 2.0': partial(wrong_friction, mu=2.0, critical=0.3),
    'friction 0.001': partial(wrong_friction, mu=1e-3, critical=1e-3),
    'friction NaN': partial(wrong_friction, mu=math.nan, critical=0.1),
    'friction 1e9': partial(wrong_friction, mu=1e9, critical=0.1, sigma=0.0),
    'odometry of wrong sign': partial(wrong_speed, scale=-1.0),
    'odometry frozen at zero': partial(wrong_speed, scale=0.0),
    'odometry frozen at 1 m/s': partial(wrong_speed, scale=0.0, offset=1.0),
    'odometry +0.3 m/s': partial(wrong_speed, offset=0.3),
    'odometry NaN': partial(wrong_speed, scale=math.nan),
}
