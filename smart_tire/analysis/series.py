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

"""Names of before for ``smart_tire.recording``, until all users import that."""

from smart_tire.arrays import Array as Floats, Instants as Stamps
from smart_tire.recording import (
    at, GroundSeries, PoseSeries, Recording as Series, seconds, SlipSeries, time_origin)

__all__ = ['at', 'Floats', 'GroundSeries', 'PoseSeries', 'seconds', 'Series', 'SlipSeries',
           'Stamps', 'time_origin']
