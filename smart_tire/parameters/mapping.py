# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of the friction mapper (``config/mapping.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, param, reliability


@dataclass(frozen=True, kw_only=True)
class FrictionMapperParams:
    """Friction mapper: map of the present drive."""

    resolution: float = param(0.1, 'm', 'edge of a cell of the map', (0.02, 10.0))
    update_period: float = param(5.0, 's', 'between two maps', (0.2, 3600.0))
    history: float = param(500.0, 'm', 'length of the driven path that is kept', (1.0, 1e5))
    reliability: str = reliability()
    robot: RobotParams = inlined(RobotParams)
