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
Figure of what the window learns on a drive over several grounds: ``docs/images/ground_tour.png``.

Run ``python -m benchmarks.robots.tour FILE [SEED]``.
"""

from __future__ import annotations

from pathlib import Path
import sys

from benchmarks.robots.draws import draw
from matplotlib.figure import Figure
import numpy as np
from smart_tire.analysis.pipeline import Pipeline
from smart_tire.samples import Friction, GroundState, NS_PER_S

ROW, SEED = 'jumps', 1
QUANTITIES = (('stiffness', 'C_x [N]'), ('friction_coefficient', 'mu [-]'),
              ('rolling_resistance', 'rolling resistance [-]'))


def tour(path: Path, seed: int) -> None:
    """Draw C_x, mu and rolling resistance with bands of two sigma, and the truth, to ``path``."""
    one = draw(ROW, seed)
    pipeline, states = Pipeline(one.params), list[GroundState]()
    for sample in one.inputs():
        states += [found for found in pipeline.update(sample) if isinstance(found, GroundState)]
    truth = [sample for sample in one.truth() if isinstance(sample, Friction)]
    origin = states[0].stamp_ns
    times = [(state.stamp_ns - origin) / NS_PER_S for state in states]
    true_times = [(sample.stamp_ns - origin) / NS_PER_S for sample in truth]
    ground = one.simulator.ground
    drag = dict(zip(ground.stiffness, ground.drag))
    true = {'stiffness': [sample.stiffness.value for sample in truth],
            'friction_coefficient': [sample.friction_coefficient.value for sample in truth]}
    true['rolling_resistance'] = [
        drag[min(drag, key=lambda stiffness: abs(stiffness - value))]
        for value in true['stiffness']]
    figure = Figure(figsize=(8.0, 6.0), layout='constrained')
    axes = figure.subplots(len(QUANTITIES), 1, sharex=True)
    for axis, (name, label) in zip(axes, QUANTITIES):
        value, sigma = np.array([getattr(state, name) for state in states]).T
        axis.fill_between(times, value - 2.0 * sigma, value + 2.0 * sigma, alpha=0.25,
                          label='two sigma')
        axis.plot(times, value, label='window')
        axis.plot(true_times, true[name], 'k.', markersize=3,
                  label='truth, at the patch crossings')
        axis.set_ylabel(label)
        axis.set_ylim(0.0, 1.6 * max(true[name]))
    axes[0].legend(loc='upper right', fontsize='small')
    axes[-1].set_xlabel('time [s]')
    figure.suptitle('concrete, sand, gravel, concrete: a robot drawn at random')
    figure.savefig(path, dpi=80)


if __name__ == '__main__':
    tour(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else SEED)
