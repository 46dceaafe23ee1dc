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

"""Recordings of a straight drive: poses and slips."""

from __future__ import annotations

from dataclasses import replace

from smart_tire.recording import Recording
from smart_tire.samples import WheelSlip
from support.ideal_robot import odometry

UNKNOWN_TWIST = (-1.0, *(0.0,) * 35)


def driven(count=400, rate=100.0, *, begin_ns=0, speed=0.5, slip=0.1, sigma=0.02, variance=0.01,
           twist=True):
    """Return ``count`` poses and slips; without ``twist`` the velocity is unknown."""
    found = Recording()
    for i in range(count):
        stamp_ns = begin_ns + round(i * 1e9 / rate)
        pose = odometry(stamp_ns, i * speed / rate, v_x=speed, variance=variance)
        found.add_sample(pose if twist else replace(pose, twist_covariance=UNKNOWN_TWIST))
        slips = slip if isinstance(slip, tuple) else (slip,) * 4
        found.add_sample(WheelSlip(stamp_ns, slips, (0.0,) * 4, (sigma,) * 4))
    return found
