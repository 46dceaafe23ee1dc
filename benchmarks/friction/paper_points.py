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

"""Points of paper B, Fig. 12 and 13, from synthesized crossings: fitted and from raw peaks."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.friction.grid import Case, WHEEL
from benchmarks.friction.methods import estimator_params, EXACT_MAP, PRINTED_MAP, WAVEFORM
from benchmarks.friction.paper_method import adhesion_ratio_from_peaks
from benchmarks.friction.synthesis import CrossingSynthesizer
import numpy as np
from smart_tire.analysis.series import Floats
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.samples import Friction

SLIPS = np.linspace(0.01, 0.3, 59)  # -, absolute


@dataclass(frozen=True)
class Points:
    """Crossings at one wheel speed, one row per slip (n,); NaN without two peaks."""

    slip: Floats
    stretch: Floats        # V, q_sm of film 1
    stretch_sigma: Floats
    ratio: Floats          # -, L_a / L
    ratio_sigma: Floats
    raw_stretch: Floats
    raw_ratio: dict[str, Floats]  # by EXACT_MAP and PRINTED_MAP


def paper_points(rpm: float, seed: int = 1) -> Points:
    """Return the points at ``rpm`` on concrete, with exact gains and true slip."""
    slips = np.concatenate([-SLIPS[::-1], SLIPS])
    fitted: list[Friction] = []
    raw: list[Friction] = []
    case = Case(slip=0.1, rpm=rpm)
    builders = {method: OutputBuilder(WHEEL, estimator_params(method, case.robot))
                for method in (WAVEFORM, PRINTED_MAP)}
    for i, slip in enumerate(slips.tolist()):
        synthesizer = CrossingSynthesizer(Case(slip=slip, rpm=rpm), seed + i, gain_error=0.0)
        crossing, state = synthesizer.crossing(), synthesizer.state()
        for builder, found in ((builders[WAVEFORM], fitted), (builders[PRINTED_MAP], raw)):
            found.append(builder.build(
                crossing, builder.method.measure(crossing, state.slip), state))
    interval = _column(raw, 'peak_interval')
    return Points(
        slips, _column(fitted, 'stretch_voltage'), _column(fitted, 'stretch_voltage', True),
        _column(fitted, 'adhesion_ratio'), _column(fitted, 'adhesion_ratio', True),
        _column(raw, 'stretch_voltage'),
        {method: adhesion_ratio_from_peaks(
            interval, np.full(len(slips), case.speed), case.robot, method)
         for method in (EXACT_MAP, PRINTED_MAP)})


def _column(estimates: list[Friction], name: str, sigmas: bool = False) -> Floats:
    return np.array([one.quantity(name)[sigmas] for one in estimates])
