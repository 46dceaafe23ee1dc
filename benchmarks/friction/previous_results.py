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

"""Results of three seeds on the same scenarios before forces were estimated."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.friction.scoring import Figures
from smart_tire.samples import NAN

FRICTION = 'mu_median', 'mu_90', 'mu_within', 'mu_nees'
STIFFNESS = 'stiffness_median', 'stiffness_90', 'stiffness_within', 'stiffness_nees'
MOTION = ('speed_y', 'slip_left', 'slip_right', 'slip_left_all_times', 'slip_right_all_times',
          'common_slip')

_CROSSINGS = {  # run and ground: FRICTION and STIFFNESS
    ('concrete', ''): (.009, .036, 1.00, .02, .000, .000, 1.00, .00),
    ('curve', ''): (.055, .100, 1.00, .17, .000, .000, 1.00, .00),
    ('sweep_60', ''): (.028, .050, 1.00, .05, .000, .000, 1.00, .00),
    ('mu_jumps', ''): (.044, .095, 1.00, .24, .000, .000, 1.00, .00),
    ('mu_jumps', 'concrete'): (.053, .102, 1.00, .31, .000, .000, 1.00, .00),
    ('mu_jumps', 'slippery'): (.039, .090, 1.00, .13, .000, .000, 1.00, .00),
    ('mu_jumps', 'rough'): (.033, .102, 1.00, .31, .000, .000, 1.00, .00),
    ('mu_jumps_fast', ''): (.024, .094, 1.00, .18, .000, .000, 1.00, .00),
    ('mu_jumps_fast', 'concrete'): (.020, .075, 1.00, .19, .000, .000, 1.00, .00),
    ('mu_jumps_fast', 'slippery'): (.025, .094, 1.00, .17, .000, .000, 1.00, .00),
    ('figure_eight', ''): (.018, .062, 1.00, .10, .000, .000, 1.00, .00),
    ('noisy', ''): (.018, .080, 1.00, .08, .000, .000, 1.00, .00),
    ('sand', ''): (.735, .848, 1.00, .90, .757, .757, 1.00, .91),
    ('sand_given', ''): (.019, .054, 1.00, .00, .000, .000, 1.00, .00),
    ('cruise', ''): (.178, .517, .99, .46, .000, .000, 1.00, .00),
    ('cruise_sand', ''): (.736, .781, 1.00, 1.97, .757, .757, .79, 2.91),
    ('braking', ''): (.020, .042, 1.00, .02, .000, .000, 1.00, .00),
    ('tour', ''): (.137, 1.084, .79, 1.92, .122, 1.108, .76, 2.77),
    ('tour', 'concrete'): (.036, .073, 1.00, .17, .000, .000, 1.00, .00),
    ('tour', 'sand'): (1.083, 1.112, .96, 1.95, 1.108, 1.108, .88, 3.04),
    ('tour', 'gravel'): (.349, .418, .10, 5.23, .387, .387, .00, 7.75),
    ('tour', 'wet_tiles'): (.126, .146, 1.00, 1.37, .122, .122, 1.00, 1.92),
    ('gravel_eight', ''): (.362, .406, .13, 4.99, .387, .387, .00, 7.78),
    ('sand_turn', ''): (1.082, 1.272, 1.00, 1.51, 1.108, 1.108, 1.00, 1.52),
    ('sand_straight', ''): (1.092, 1.175, .99, 3.16, 1.108, 1.108, .50, 5.98),
    ('concrete_straight', ''): (.091, .241, 1.00, .05, .000, .000, 1.00, .00),
    ('center_of_mass', ''): (.157, .215, 1.00, 1.02, .000, .000, 1.00, .00),
    ('torque_constant', ''): (.306, .376, .51, 2.93, .387, .387, .42, 4.47),
    ('torque_constant', 'concrete'): (.033, .071, 1.00, .15, .000, .000, 1.00, .00),
    ('torque_constant', 'gravel'): (.353, .410, .15, 4.97, .387, .387, .00, 7.73),
    ('torque_calibrated', ''): (.306, .376, .51, 2.93, .387, .387, .42, 4.47),
    ('torque_calibrated', 'concrete'): (.033, .071, 1.00, .15, .000, .000, 1.00, .00),
    ('torque_calibrated', 'gravel'): (.353, .410, .15, 4.97, .387, .387, .00, 7.73),
    ('bumps_far', ''): (.104, .130, 1.00, .36, .000, .000, 1.00, .00),
    ('bumps_skewed', ''): (.036, .119, 1.00, .16, .000, .000, 1.00, .00),
    ('release_mixed', ''): (.477, .773, .00, 375.52, .000, .000, 1.00, .00),
    ('heavy', ''): (1.000, 1.029, .98, 1.62, 1.000, 1.000, .81, 4.19),
    ('heavy', 'concrete'): (.009, .036, 1.00, .03, .000, .000, 1.00, .00),
    ('heavy', 'sand'): (1.021, 1.029, .97, 2.70, 1.000, 1.000, .68, 7.13),
}
_MOTION = {  # run: MOTION
    'concrete': (.0036, .0024, .0043, .0192, .0202, NAN),
    'curve': (.0047, .0178, .0133, .0244, .0211, NAN),
    'sweep_60': (.0035, .0176, .0106, .0270, .0211, .0125),
    'mu_jumps': (.0071, .0182, .0122, .0228, .0181, NAN),
    'mu_jumps_fast': (.0112, .0308, .0092, .0381, .0189, NAN),
    'figure_eight': (.0045, .0069, .0067, .0231, .0230, NAN),
    'noisy': (.0045, .0079, .0086, .0303, .0347, NAN),
    'sand': (.0043, .0029, .0054, .0278, .0301, NAN),
    'sand_given': (.0044, .0029, .0053, .0277, .0300, NAN),
    'cruise': (.0019, .0101, .0101, .0194, .0194, .0100),
    'cruise_sand': (.0019, .0050, .0049, .0244, .0259, .0048),
    'braking': (.0019, NAN, NAN, .0476, .0504, NAN),
    'tour': (.0082, .0125, .0123, .0255, .0248, NAN),
    'gravel_eight': (.0045, .0078, .0074, .0260, .0255, NAN),
    'sand_turn': (.0047, .0033, .0060, .0217, .0246, NAN),
    'sand_straight': (.0020, .0138, .0138, .0830, .0824, .0144),
    'concrete_straight': (.0020, .0137, .0136, .0300, .0281, .0138),
    'center_of_mass': (.0053, .0088, .0095, .0249, .0257, NAN),
    'torque_constant': (.0088, .0110, .0112, .0265, .0247, NAN),
    'torque_calibrated': (.0088, .0110, .0112, .0265, .0247, NAN),
    'bumps_far': (.0046, .0178, .0133, .0263, .0205, NAN),
    'bumps_skewed': (.0046, .0178, .0133, .0263, .0205, NAN),
    'release_mixed': (.0046, .0178, .0133, .0263, .0205, NAN),
    'heavy': (.0054, .0105, .0101, .0236, .0242, NAN),
}

PREVIOUS_RESULTS: Mapping[tuple[str, str], Figures] = {
    (run, ground): dict(zip((*FRICTION, *STIFFNESS, *MOTION), (*crossings, *_MOTION[run])))
    for (run, ground), crossings in _CROSSINGS.items()}
