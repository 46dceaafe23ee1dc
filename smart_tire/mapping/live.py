# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The map of a drive that goes on: samples in, maps out."""

from __future__ import annotations

from collections import deque
from itertools import chain
import math

from smart_tire.errors import ParameterError
from smart_tire.mapping.grid import friction_map, FrictionMap
from smart_tire.mapping.track import friction_track, SPACING
from smart_tire.parameters.mapping import FrictionMapperParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import Friction, GroundState, Odometry

MAX_JUMP = 1.0  # m, between poses; a larger one: the odometry was reset; assumed


class LiveMap:
    """Keeps the estimates of the last ``history`` [m] of a drive, whose map it computes."""

    def __init__(self, params: FrictionMapperParams) -> None:
        self._params = params
        self._poses = deque[Odometry](maxlen=math.ceil(params.history / SPACING))
        self._grounds = deque[GroundState | Friction]()
        self.restarts = 0
        self.fault = ''  # why there is no map

    def add_pose(self, pose: Odometry) -> None:
        """Add a pose; those nearer than ``SPACING`` to the one before are left out."""
        if self._poses:
            last = self._poses[-1]
            step = math.dist(pose.position[:2], last.position[:2])
            if pose.stamp_ns <= last.stamp_ns or step > MAX_JUMP:
                self._poses.clear()
                self._grounds.clear()
                self.restarts += 1
            elif step < SPACING:
                return
        self._poses.append(pose)

    def add_estimate(self, estimate: GroundState | Friction) -> None:
        """Add an estimate of the ground or the friction."""
        self._grounds.append(estimate)
        while self._poses and self._grounds[0].stamp_ns < self._poses[0].stamp_ns:
            self._grounds.popleft()

    def map(self, frame: str) -> FrictionMap | None:  # noqa: A003
        """Return the map in the ``frame`` of the poses, None without any friction."""
        found = SampleArrays(chain(self._poses, self._grounds))
        try:
            made = friction_map([friction_track(
                found.poses(), found.grounds(), found.frictions(), self._params.robot,
                frame=frame)], self._params.resolution)
        except ParameterError as error:
            self.fault = str(error)
            return None
        self.fault = ''
        return made
