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

"""Evaluation of a recorded drive: its path, estimates and, in simulation, ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from smart_tire.analysis.drawing import DOTS_PER_INCH
from smart_tire.analysis.driven_paths import driven_lines, driven_tree, PATH_TOPICS, PathLog
from smart_tire.analysis.ground_areas import Grounds
from smart_tire.analysis.labels import label_estimates
from smart_tire.analysis.path_figures import path_figure
from smart_tire.analysis.report import estimate_lines
from smart_tire.analysis.series import Series
from smart_tire.analysis.summary import estimates_tree, plain, Tree, truth_tree
from smart_tire.analysis.tracking_figures import tracking_figure
from smart_tire.bags import Bag
from smart_tire.estimation.streams import ESTIMATES

TRUTHS = ('ground_truth/odom', 'ground_truth/wheel_slip', 'ground_truth/tire_friction')


def evaluate_drive(bag_path: Path, name: str, figure: Path,
                   grounds: Grounds | None = None) -> Tree:
    """
    Return the summary of a drive and draw its ``figure``.

    The figure shows the last path that was followed, or the driven path alone if there is none;
    it is not drawn without poses. ``grounds`` are those of the simulation.
    """
    estimates, truth, log = Series(), Series(), PathLog()
    with Bag(bag_path) as bag:
        begin, end = bag.span_ns
        for receive_ns, topic, sample in bag.samples((*ESTIMATES, *TRUTHS, *PATH_TOPICS)):
            log.add(receive_ns, sample)
            (truth if topic in TRUTHS else estimates).add(sample)
    drives = log.driven(estimates.poses(), truth.poses())
    if drives or len(estimates.poses().stamp_ns):
        drawn = (tracking_figure(drives[-1], grounds) if drives
                 else path_figure(label_estimates(estimates), truth))
        drawn.savefig(figure, dpi=DOTS_PER_INCH)
    return plain({
        'bag': str(bag_path), 'drive': name, 'duration_s': (end - begin) * 1e-9,
        'tracking': driven_tree(drives[-1]) if drives else None,
        'estimates': estimates_tree(estimates), 'against_truth': truth_tree(estimates, truth)})


def lines(tree: Tree) -> Iterator[str]:
    """Yield the summary of ``evaluate_drive`` as lines of text."""
    if tree['tracking'] is not None:
        yield from driven_lines(tree['drive'], tree['tracking'])
    yield from estimate_lines(tree['estimates'])
    if pose := (tree['against_truth'] or {}).get('pose'):
        yield (f'  odom error at the end: {pose["position_end_m"]:.2f} m, '
               f'{pose["yaw_end_rad"]:+.3f} rad')
