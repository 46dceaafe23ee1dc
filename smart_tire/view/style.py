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

"""Names, units and colors of what the viewer shows."""

from __future__ import annotations

from smart_tire.samples import WHEELS

Color = tuple[int, int, int]

TIMELINE = 'time'  # of message stamps, from the first one
SIGMAS = 2.0       # of the bounds around an estimate

# By wheel, to be distinguished by color-blind readers too (Okabe and Ito).
WHEEL_COLORS: dict[str, Color] = dict(zip(WHEELS, (
    (86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167))))
ESTIMATE: Color = (86, 180, 233)
TRUTH: Color = (128, 128, 128)  # visible on dark and on light background
COMMAND: Color = (213, 94, 0)
AXIS: Color = (110, 110, 110)
WARNING: Color = (213, 94, 0)
FILM_COLORS: tuple[Color, ...] = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167))
XYZ_COLORS: tuple[Color, ...] = ((220, 80, 80), (90, 200, 90), (90, 130, 250))
NODE_COLORS: tuple[Color, ...] = (
    (86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167), (213, 94, 0), (0, 114, 178),
    (150, 150, 255), (190, 190, 190), (160, 110, 60))

LINE_WIDTH, BOUND_WIDTH = 2.0, 0.75  # points of the screen


def dimmed(color: Color, share: float = 0.55) -> Color:
    """Return a darker color, for the bounds around a curve of ``color``."""
    red, green, blue = (round(share * part) for part in color)
    return red, green, blue
