# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Makes docs/images/demo.gif: the drive of a demo, with path, slip and friction.

``python docs/animation.py demo_output`` after ``make demo``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from smart_tire.analysis.dead_reckoning import GYRO_WHEELS
from smart_tire.analysis.drawing import render
from smart_tire.analysis.drive_report import read_run
from smart_tire.analysis.figure import Curve, decimated, Figure, Limits, Mark, Panel, truth_marks
from smart_tire.analysis.figures import friction_figure
from smart_tire.analysis.metrics import carried, rotated
from smart_tire.analysis.motion_figures import BASELINE_COLOR, slip_figure
from smart_tire.analysis.result import Result
from smart_tire.arrays import Array
from smart_tire.parameters import RobotParams
from smart_tire.paths import find_bag
from smart_tire.recording import seconds

PICTURE = Path(__file__).resolve().parent / 'images' / 'demo.gif'
STEP = 1.0                  # s of the drive, from frame to frame
FRAME, LAST = 100, 3000     # ms that a frame is shown, and the last one
DOTS_PER_INCH, COLORS = 80, 64
CELL = 4.6, 2.1             # inch
MAX_FRICTION = 0.8          # upper end of the friction axis
ROBOT = RobotParams()


def frames(result: Result) -> list[Image.Image]:
    """Return the pictures of the drive until 1 s, 2 s and so on."""
    slip, friction = slip_figure(result), friction_figure(result)
    own, base = result.filtered.poses, result.filtered.baselines.get(GYRO_WHEELS)
    if slip is None or friction is None or base is None:
        raise SystemExit('the recording has no slip, no friction or no ground truth')
    time = seconds(own.stamp_ns, result.origin_ns)
    paths = {GYRO_WHEELS: carried(base.estimated, base.true[0], own.true[0]),
             'estimate': own.estimated, 'truth': own.true}
    frame = Mark(Curve(*np.concatenate(list(paths.values()))[:, :2].T), opacity=0.0)
    fused = friction.panels[0]
    drawn = [_thinned(panel) for panel in (slip.panels[0], replace(
        fused, marks=fused.marks[1:], y_limits=(0.0, MAX_FRICTION), title=f'{fused.title} wheel'))]
    pictures = []
    for end in np.arange(STEP, time[-1], STEP):
        count = int(np.searchsorted(time, end))
        left = Panel([frame, *_path_marks(paths, count)], 'x [m]', 'y [m]',
                     f'simulated drive, {end:.0f} s', equal=True)
        pictures.append(_picture([[left, until(panel, end, (0.0, time[-1]))]
                                  for panel in drawn]))
    return pictures


def _path_marks(paths: dict[str, Array], count: int) -> list[Mark]:
    """Return the beginnings of the paths, of ``count`` poses, and the estimated robot."""
    base, estimate, true = (Curve(*path[:count, :2].T) for path in paths.values())
    *position, yaw = paths['estimate'][count - 1]
    x, y = 0.5 * ROBOT.wheelbase + ROBOT.wheel_radius, 0.5 * ROBOT.track_width
    corners = np.array([(0.0, 0.0), (x, 0.0), (x, y), (-x, y), (-x, -y), (x, -y), (x, 0.0)])
    body = rotated(corners, yaw) + position
    return [Mark(base, GYRO_WHEELS, BASELINE_COLOR, width=1.6),
            Mark(estimate, 'estimate', width=1.6), *truth_marks(true),
            Mark(Curve(*body.T), '', 'ink', width=2.0)]


def _thinned(panel: Panel) -> Panel:
    """Return ``panel`` with few enough points, the same in all frames."""
    return replace(panel, marks=[replace(mark, curve=decimated(mark.curve))
                                 for mark in panel.marks])


def until(panel: Panel, end: float, limits: Limits) -> Panel:
    """Return ``panel`` over ``limits`` [s], with the curves until ``end`` [s]."""
    return replace(panel, x_limits=limits, marks=[
        replace(mark, curve=mark.curve.at_rows(np.flatnonzero(mark.curve.x <= end)))
        for mark in panel.marks])


def _picture(rows: Sequence[Sequence[Panel]]) -> Image.Image:
    """Return the drawn panels; the one on the left, which is in both rows, is the first one."""
    first, buffer = rows[0][0], BytesIO()
    render(Figure('demo', '', '', [[first, panel] for _, panel in rows], CELL,
                  panel_legends=True)).savefig(buffer, dpi=DOTS_PER_INCH)
    return Image.open(buffer).convert('RGB')


def save(pictures: Sequence[Image.Image], path: Path) -> None:
    """Write ``pictures`` as an animation that repeats, in the most frequent colors of the last."""
    last = np.asarray(pictures[-1]).reshape(-1, 3)
    colors, counts = np.unique(last, axis=0, return_counts=True)
    palette = Image.new('P', (1, 1))
    palette.putpalette(colors[np.argsort(-counts)[:COLORS]].ravel().tolist())
    first, *others = (one.quantize(palette=palette, dither=Image.Dither.NONE)
                      for one in pictures)
    first.save(path, save_all=True, append_images=others, loop=0, optimize=True,
               duration=[*[FRAME] * len(others), LAST])


def main() -> None:
    """Write the animation of the recording given on the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bag', type=Path)
    parser.add_argument('--out', type=Path, default=PICTURE)
    args = parser.parse_args()
    save(frames(read_run(find_bag(args.bag)).result), args.out)
    print(f'{args.out}: {args.out.stat().st_size / 1e3:.0f} kB')


if __name__ == '__main__':
    main()
