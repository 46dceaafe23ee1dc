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
Figure of delayed bases, and of a square on a slope: ``docs/images/path_tracking.png``.

Run ``python -m benchmarks.control.figure FILE``.
"""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
import sys

from benchmarks.control.drawn import draw_robot, DrawnRobot, driven, PATHS, PURSUIT
from benchmarks.control.scenarios import OURS, SHORT
from benchmarks.control.tracking import sampled, score_drive
from matplotlib.figure import Figure
import numpy as np
from smart_tire.arrays import Array

DELAYS = (0.0, 0.1, 0.2, 0.3, 0.4)  # s, from cmd_vel to the wheel control
LATE, SLOPING = (321, 322, 323), 305  # seeds


def track(robot: DrawnRobot, path: str, controller: str) -> tuple[Array, float, bool]:
    """Return true positions (n, 2) along a path, rms distance [m], and whether it arrived."""
    stack = driven(robot, path, controller, estimated=False)
    _, found = score_drive(stack)
    return np.array([one.position[:2] for one in sampled(stack.drive()[0])]), (
        found['true_rms']), bool(found['arrived'])


def draw(file: Path) -> None:
    """Draw the figure to ``file``, and print its numbers."""
    figure = Figure(figsize=(10.0, 4.5), layout='constrained')
    sweep, square = figure.subplots(1, 2)
    for controller in (OURS, SHORT, PURSUIT):
        means = []
        for delay in DELAYS:
            runs = [track(replace(draw_robot(seed), command_delay=delay), 'S', controller)
                    for seed in LATE]
            means.append(1e3 * np.mean([rms for _, rms, _ in runs]))
            print(f'{controller}, {delay:g} s: {means[-1]:.1f} mm, '
                  f'{sum(arrived for *_, arrived in runs)} of {len(LATE)} arrive', flush=True)
        sweep.plot(1e3 * np.array(DELAYS), means, 'o-', label=controller)
    sweep.set(xlabel='delay of cmd_vel [ms]', ylabel='rms distance from the path [mm]',
              title=f'S, {len(LATE)} robots drawn at random', ylim=(0.0, None))
    sweep.legend()
    robot = draw_robot(SLOPING)
    square.plot(*np.array(PATHS['square'].poses)[:, :2].T, 'k--', linewidth=1)
    for controller in (OURS, SHORT):
        positions, rms, _ = track(robot, 'square', controller)
        print(f'square, {controller}: {1e3 * rms:.1f} mm', flush=True)
        square.plot(*positions.T, label=controller)
    direction = (robot.traits.direction or 0.0) + math.pi
    square.annotate('downhill', (1.0 + 0.4 * math.cos(direction),
                                 1.0 + 0.4 * math.sin(direction)), (1.0, 1.0),
                    arrowprops={'arrowstyle': '->'}, ha='center')
    mu = ', '.join(f'{one:.2f}' for one in robot.simulator.ground.friction)
    square.set(xlabel='x [m]', ylabel='y [m]', aspect='equal',
               title=f'{math.degrees(robot.traits.slope):.1f} degrees, friction {mu}')
    square.legend()
    figure.savefig(file, dpi=80)


if __name__ == '__main__':
    draw(Path(sys.argv[1]))
