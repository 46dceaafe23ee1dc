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

"""Monte Carlo trials: estimates from synthesized crossings by all methods, with true slip."""

from __future__ import annotations

from dataclasses import dataclass
import math
import time

from benchmarks.friction.cramer_rao import friction_bound
from benchmarks.friction.grid import Case, LOAD, WHEEL
from benchmarks.friction.methods import estimator_params, EXACT_MAP, PRINTED_MAP, WAVEFORM
from benchmarks.friction.paper_method import friction_from_peaks
from benchmarks.friction.records import SINGLE
from benchmarks.friction.scoring import spread
from benchmarks.friction.synthesis import CrossingSynthesizer
import numpy as np
from smart_tire.analysis.series import Floats
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.estimation.ground.estimator import WheelState
from smart_tire.samples import Friction


@dataclass(frozen=True)
class Trial:
    """Scores of one method on the crossings of a case; errors are relative to the true mu."""

    finite: float  # share of crossings with an estimate
    bias: float    # median error
    spread: float  # standard deviation, from the interquartile range
    large: float   # 90 % quantile of absolute errors
    nees: float    # 1 if consistent; NaN without sigmas
    ms: float      # CPU time per crossing, without its detection


@dataclass(frozen=True)
class CaseResult:
    """Scores of all methods on the crossings of a case."""

    group: str
    case: Case
    bound: float   # Cramer-Rao bound, relative
    crossings: int
    found: float   # share of crossings with both films detected
    trials: dict[str, Trial]


def run_case(group: str, case: Case, count: int, seed: int = 1) -> CaseResult:
    """Return the scores of all applicable methods on ``count`` crossings."""
    synthesizer = CrossingSynthesizer(case, seed)
    crossings, state = [synthesizer.crossing() for _ in range(count)], synthesizer.state()
    estimates, ms = _report(crossings, state, case, WAVEFORM)
    trials = {WAVEFORM: trial(_column(estimates, SINGLE), case.mu, ms, sigma=np.array(
        [one.quantity(SINGLE).sigma for one in estimates]))}
    if case.release == 'fig8' and case.slip > 0.0:  # where two peaks exist
        estimates, ms = _report(crossings, state, case, PRINTED_MAP)
        interval, constant = _column(estimates, 'peak_interval'), np.ones(count)
        for method in (EXACT_MAP, PRINTED_MAP):
            trials[method] = trial(friction_from_peaks(
                interval, case.speed * constant, case.total_slip * constant, LOAD * constant,
                case.robot, method), case.mu, ms)
    complete = [one.samples is not None and len(one.samples.films) == 2 for one in crossings]
    return CaseResult(group, case, friction_bound(
        case.robot, WHEEL, slip=case.slip, normalized_slip=case.normalized_slip,
        speed=case.speed), count,
        float(np.mean(complete)), trials)


def _report(crossings: list[PatchCrossing], state: WheelState, case: Case,
            method: str) -> tuple[list[Friction], float]:
    """Return the estimates of one method, and CPU time per crossing [ms]."""
    builder = OutputBuilder(WHEEL, estimator_params(method, case.robot))
    begin = time.thread_time()
    estimates = [builder.build(crossing, builder.method.measure(crossing, state.slip), state)
                 for crossing in crossings]
    return estimates, 1e3 * (time.thread_time() - begin) / len(crossings)


def _column(estimates: list[Friction], name: str) -> Floats:
    return np.array([one.quantity(name).value for one in estimates])


def trial(value: Floats, truth: float, ms: float, sigma: Floats | None = None) -> Trial:
    """Return the scores of estimates of ``truth``; NaN means no estimate."""
    finite = np.isfinite(value)
    error = value[finite] / truth - 1.0
    if not len(error):
        return Trial(0.0, math.nan, math.nan, math.nan, math.nan, ms)
    nees = (math.nan if sigma is None
            else float(np.mean(((value[finite] - truth) / sigma[finite])**2)))
    return Trial(float(np.mean(finite)), float(np.median(error)), spread(error),
                 float(np.quantile(np.abs(error), 0.9)), nees, ms)
