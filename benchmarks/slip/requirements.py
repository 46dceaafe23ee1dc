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

"""Required slip errors of the live estimator, without and with torque."""

from __future__ import annotations

# Run -> rms errors of the left and the right side: in steady intervals, on the straight run at all
# times against averaged truth.
MAX_SLIP_ERRORS = {
    'sweep_60': (0.011, 0.007),
    'sweep_80': (0.011, 0.007),
    'figure_eight': (0.006, 0.006),
    'straight': (0.038, 0.038),
}
