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

"""Figures of long recordings: an overview of each panel, and segments of it below."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from string import ascii_uppercase

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from smart_tire.analysis import drawing

Segments = Sequence[tuple[float, float]]  # s
Draw = Callable[[Axes, bool], None]       # draws a panel, in brief if it is an overview


def overview_figure(draw: Mapping[str, Draw], segments: Segments, *,
                    panel_height: float) -> tuple[Figure, dict[str, Axes]]:
    """
    Return a figure with a panel of each name, and its axes by name.

    ``draw`` draws the content of a panel. With ``segments`` the content is also drawn in one panel
    per segment below, and the segments are marked in the overview by letters.
    """
    rows = []
    for name in draw:
        rows.append([name] * max(len(segments), 1))
        if segments:
            rows.append([f'{name}, {letter}' for letter, _ in zip(ascii_uppercase, segments)])
    figure, axes = drawing.new_figure(
        rows, height=1.6 + panel_height * len(rows), share_x=not segments, share_y=True,
        width=9.0 if not segments else 11.0)
    for name, draw_panel in draw.items():
        draw_panel(axes[name], bool(segments))
        axes[name].set_title(name)
        for letter, (first, last) in zip(ascii_uppercase, segments):
            part = axes[f'{name}, {letter}']
            draw_panel(part, False)
            part.set(xlim=(first, last), title=f'{letter}: {first:.0f} s to {last:.0f} s')
            drawing.mark_segment(axes[name], letter, first, last)
    return figure, axes
