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

"""Results of the live estimator, three seeds, before forces were estimated."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.slip.results import Figures

FIGURES = ('slip_left', 'slip_right', 'slip_left_all_times', 'slip_right_all_times', 'speed',
           'speed_all_times', 'position_rms_percent', 'position_end_percent', 'heading_rms',
           'heading_end')

_RUNS = {  # run: FIGURES
    'concrete': (.0023, .0043, .0192, .0202, .0032, .0035, .043, .048, .0056, .0122),
    'sand': (.0030, .0058, .0298, .0301, .0038, .0037, .079, .102, .0056, .0123),
    'sweep_60': (.0172, .0104, .0268, .0211, .0060, .0057, .134, .139, .0069, .0136),
    'sweep_80': (.0163, .0085, .0275, .0205, .0064, .0061, .136, .194, .0072, .0140),
    'mu_jumps': (.0181, .0121, .0226, .0180, .0102, .0099, .291, .510, .0132, .0207),
    'figure_eight': (.0068, .0068, .0230, .0229, .0049, .0051, .049, .049, .0243, .0193),
    'stop_and_go': (.0154, .0143, .0705, .0762, .0079, .0083, .535, .993, .0116, .0164),
    'degraded': (.0067, .0074, .0297, .0325, .0055, .0056, .068, .120, .0229, .0361),
    'late_wheels': (.0082, .0087, .0405, .0394, .0066, .0067, .068, .102, .0229, .0344),
    'gaps': (.0073, .0073, .0250, .0271, .0055, .0057, .091, .120, .0538, .0536),
    'straight': (.0479, .0495, .0487, .0503, .0162, .0148, .390, .237, .0030, .0067),
    'spin_reverse': (.0113, .0119, .0613, .0660, .0062, .0058, .492, .837, .0063, .0131),
}

PREVIOUS_RESULTS: Mapping[str, Figures] = {
    run: dict(zip(FIGURES, values)) for run, values in _RUNS.items()}
