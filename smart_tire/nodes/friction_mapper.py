# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``friction_mapper``: map of the friction on the tracks of the present drive."""

from __future__ import annotations

import sys

from smart_tire.mapping.live import LiveMap
from smart_tire.mapping.raster import grid_of
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.runner import run
from smart_tire.parameters.mapping import FrictionMapperParams


class FrictionMapper(SmartTireNode[FrictionMapperParams]):
    """
    Combines friction and poses in a map, every ``update_period``.

    Subscribes to ``odom``, ``ground_state`` and ``tire_friction``; publishes ``friction_map``,
    which late subscribers get, too, and ``/diagnostics``.

    Parameters: ``resolution``, ``update_period``, ``history``, ``reliability``, and those of the
    robot.
    """

    def __init__(self) -> None:
        super().__init__('friction_mapper', FrictionMapperParams)
        self._map = LiveMap(self.params)
        self._mapped = self._cells = 0  # estimates and cells of the latest map
        self._publish = self.make_publisher('friction_map')
        self.subscribe('odom', self._map.add_pose, required=True,
                       reliability=self.params.reliability)
        for name in ('ground_state', 'tire_friction'):
            self.subscribe(name, self._map.add_estimate, announced=True,
                           reliability=self.params.reliability)
        self.call_every(self.params.update_period, self.update)

    def update(self) -> None:
        """Publish a new map if there are new estimates."""
        estimates = sum(self.inputs[name].ok for name in ('ground_state', 'tire_friction'))
        if estimates == self._mapped:
            return
        self._mapped = estimates
        found = self._map.map(self.params.robot.frames['odom'])
        if found is not None:
            self._cells = int(found.cells.current.sum())
            self._publish(grid_of(found.raster, int(found.cells.stamp_ns.max())))

    def fill_status(self, status: Status) -> None:
        """Add the size of the map, and why there is none."""
        status.values.update(cells=self._cells, restarts=self._map.restarts,
                             map=self._map.fault or ('known' if self._cells else 'none yet'))


def main() -> int:
    """Run the node."""
    return run(FrictionMapper)


if __name__ == '__main__':
    sys.exit(main())
