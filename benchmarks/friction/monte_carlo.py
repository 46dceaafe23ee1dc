# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Monte Carlo trials: estimates from synthesized crossings with the true slip."""

from __future__ import annotations

from collections.abc import Callable
import time

from benchmarks.friction.cramer_rao import friction_bound
from benchmarks.friction.crossings import SINGLE
from benchmarks.friction.grid import Case, LOAD, WHEEL
from benchmarks.friction.paper_method import friction_from_peaks, MAPS
from benchmarks.friction.synthesis import CrossingSynthesizer
from benchmarks.scoring import Errors, Run
import numpy as np
from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.output import friction_record
from smart_tire.estimation.friction.waveform_method import FilmResult, WaveformMethod
from smart_tire.estimation.ground.estimator import WheelState
from smart_tire.papers.printed import TwoPeakMethod
from smart_tire.samples import Friction
from smart_tire.uncertain import Uncertain


def run_case(row: str, case: Case, count: int, seed: int = 1) -> Run:
    """
    Return relative errors of mu from ``count`` crossings, by the waveform and from two peaks.

    ``bounded`` are those of the waveform with the Cramer-Rao bound as sigma.
    """
    synthesizer = CrossingSynthesizer(case, seed)
    crossings, state = [synthesizer.crossing() for _ in range(count)], synthesizer.state()
    waveform = WaveformMethod(WHEEL, case.robot)
    estimates, ms = _estimates(
        crossings, state, case, lambda crossing, slip: waveform.measure(crossing))
    error, sigma = _column(estimates, SINGLE) / case.mu - 1.0, _column(estimates, SINGLE, True)
    bound = friction_bound(case.robot, WHEEL, slip=case.slip,
                           normalized_slip=case.normalized_slip, speed=case.speed)
    errors = {'single': Errors(error, sigma / case.mu),
              'bounded': Errors(error, np.full(count, bound))}
    if case.release == 'fig8' and case.slip > 0.0:  # where two peaks exist
        peaks, _ = _estimates(
            crossings, state, case, TwoPeakMethod(WHEEL, case.robot, 'printed').measure)
        interval, constant = _column(peaks, 'peak_interval'), np.ones(count)
        for which in MAPS:
            errors[which] = Errors.without_sigma(friction_from_peaks(
                interval, case.speed * constant, case.total_slip * constant, LOAD * constant,
                case.robot, which) / case.mu - 1.0)
    complete = [one.samples is not None and len(one.samples.films) == 2 for one in crossings]
    return Run(row, seed, errors, {'bound': bound, 'found': float(np.mean(complete)), 'ms': ms})


def _estimates(crossings: list[PatchCrossing], state: WheelState, case: Case,
               measure: Callable[[PatchCrossing, Uncertain], FilmResult | None]
               ) -> tuple[list[Friction], float]:
    """Return the estimates, and CPU time per crossing [ms] without its detection."""
    begin, length = time.thread_time(), case.robot.tire.contact_length
    estimates = [friction_record(WHEEL, length, one, measure(one, state.slip), state)
                 for one in crossings]
    return estimates, 1e3 * (time.thread_time() - begin) / len(crossings)


def _column(estimates: list[Friction], name: str, sigmas: bool = False) -> Array:
    return np.array([one.quantity(name)[sigmas] for one in estimates])
