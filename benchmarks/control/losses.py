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
Whether robots drawn at random track a path worse than with ideal kinematics by more than noise.

``python -m benchmarks.control.losses FILE`` repeats the losses in ``results.json`` of ``--runs
drawn`` with other errors of the sensors, the same for both: ours, ideal, and the mean difference
with its standard error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product
import json
from pathlib import Path
import sys

from benchmarks.control.drawn import draw_robot, driven, PATHS
from benchmarks.control.run import DRAWN
from benchmarks.control.scenarios import OURS, SHORT
from benchmarks.control.tracking import score_drive
from benchmarks.harness import run_jobs
from benchmarks.scoring import mean, standard_error

NOISES = range(1, 9)  # seeds of the errors of sensors


def pair(path: str, seed: int, noise: int) -> tuple[float, float]:
    """Return the rms distances [m] of the robot of ``seed`` from a path: ours, ideal."""
    robot = draw_robot(seed)
    other = replace(robot, simulator=replace(robot.simulator, seed=noise))
    ours, ideal = (score_drive(driven(other, path, controller, estimated=False))[1]['true_rms']
                   for controller in (OURS, SHORT))
    return ours, ideal


def main(file: Path) -> None:
    """Print a row of a Markdown table for each loss."""
    rows = json.loads(file.read_text(encoding='utf-8'))['rows']
    lost = [(path, int(seed)) for path in PATHS
            for seed, found in rows[f'{DRAWN}/{path}']['seeds'].items()
            if found[f'{SHORT}.ratio'] > 1.0]
    found = run_jobs([partial(pair, *one, noise) for one, noise in product(lost, NOISES)], str)
    for number, (path, seed) in enumerate(lost):
        own = found[number * len(NOISES):(number + 1) * len(NOISES)]
        ours, ideal = (1e3 * mean(values) for values in zip(*own))
        error = 1e3 * standard_error([one - other for one, other in own])
        print(f'| {path}, {seed} | {ours:.2f} | {ideal:.2f} | {ours - ideal:.2f} +- {error:.2f} |')


if __name__ == '__main__':
    main(Path(sys.argv[1]))
