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

"""What the analysis did not use or could not estimate, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from smart_tire.analysis.curves import MAX_SLIP_SIGMA
from smart_tire.analysis.friction_metrics import column, is_informative, MAX_RELATIVE_SIGMA
from smart_tire.analysis.html_report.tables import Table
from smart_tire.analysis.offline import Analysis, BagContents
from smart_tire.analysis.report import percent
from smart_tire.analysis.series import SlipSeries
from smart_tire.analysis.summary import Tree
from smart_tire.samples import Friction


def skipped_lines(contents: BagContents) -> list[str]:
    """Return what was skipped, without the warnings of the reader."""
    return [text for text in contents.skipped if text not in contents.warnings]


def left_out_table(analysis: Analysis, inputs: Tree) -> Table:
    """Return the numbers of messages and estimates that were left out, with the reasons."""
    rows = [[topic, reason, str(one[kind])] for topic, one in sorted(inputs.items())
            for kind, reason in (
                ('late', 'late: arrived after the estimators had passed its timestamp'),
                ('rejected', 'rejected: invalid content')) if one[kind]]
    slips = analysis.estimates.slips()
    if slips.ratio.size:
        rows += _slip_rows(slips)
    rows += _friction_rows(analysis.estimates.crossings)
    return Table('Messages and estimates left out.', ['what', 'reason', 'number'], rows, 2)


def _slip_rows(slips: SlipSeries) -> list[list[str]]:
    standstill = np.isnan(slips.ratio)
    unknown = ~standstill & ~(slips.sigma <= MAX_SLIP_SIGMA)
    return [['slip ratios of wheels', reason, f'{part.sum()} ({percent(part.mean())})']
            for part, reason in (
                (standstill, 'standstill: the slip ratio is undefined'),
                (unknown, f'σ above {MAX_SLIP_SIGMA}: not observable; not drawn, but counted in '
                          'the errors by surface')) if part.any()]


def _friction_rows(crossings: Sequence[Friction]) -> list[list[str]]:
    rows = []
    for wheel, count in sorted(Counter(one.wheel for one in crossings).items()):
        own = [one for one in crossings if one.wheel == wheel]
        single = column(own, 'friction_coefficient_single')
        sigma = column(own, 'friction_coefficient_single', sigmas=True)
        unknown = ~np.isfinite(single)
        vague = ~unknown & ~is_informative(single, sigma)
        rows += [[f'single crossings of {wheel.replace("_", " ")}', reason,
                  f'{part.sum()} of {count}'] for part, reason in (
                      (unknown, 'friction not observable, such as at low slip'),
                      (vague, f'uninformative: σ above {MAX_RELATIVE_SIGMA:.0%} of the value'))
                 if part.any()]
    return rows
