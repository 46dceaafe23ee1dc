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
Sections of paper A.

Deflections in figures have the sign of the paper, negative when buckled.
"""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from smart_tire.analysis.figure import Curve, dots, Mark, Panel, straight, TIME_LABEL
from smart_tire.estimation.film.calibration import PRODUCTS
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import TABLE_I_GAIN
from smart_tire.papers.film_experiments import (
    FREQUENCY, Loop, Proportionality, RateIndependence, TableOneFits, Trace)
from smart_tire.papers.report import PaperSection, section
from smart_tire.uncertain import Uncertain

MM, NC, PC = 1e3, 1e9, 1e12  # from SI units
DELTA, CHARGE = 'deflection Δ [mm]', 'charge $Q_e$ [nC]'
CYCLES = 5 / FREQUENCY  # s, shown in Fig. 8 and 9
SYMBOLS = r'$\alpha K$', '$aK$', '$bK$'
MODELS = (('exact', 'exact elastica and Duhem operator', 'ink', False),
          ('printed', 'A(15) as printed and Duhem operator', 'vermillion', True),
          ('linear', 'A(16) and Duhem operator', 'shade', True))
SIGNIFICANCE_SIGMAS = 3.0
MAX_FREQUENCY_SLOPE = 0.01  # relative change per decade of frequency that counts as constant
MIN_LINE_R2 = 0.95          # R^2 of points that appear as a straight line in a graph


def trace_section(trace: Trace) -> PaperSection:
    """Return Fig. 4: charge and deflection over time, and the loop."""
    loop = trace.loop
    over_time = [Panel([Mark(Curve(trace.time, values), color=color)], TIME_LABEL, label)
                 for values, color, label in (
                     (NC * (trace.charge - trace.charge.mean()), 'blue', CHARGE),
                     (-MM * trace.deflection, 'orange', DELTA))]
    both = Panel([_loop(loop, '5 Hz')], DELTA, CHARGE)
    return section('paper_a_fig_4', [[one, both] for one in over_time], (5.5, 2.2),
                   {'lags': loop.lag > 0.0}, peak=NC * loop.peak, lag=math.degrees(loop.lag),
                   height=loop.height)


def rate_section(result: RateIndependence) -> PaperSection:
    """Return Fig. 6: loops at two frequencies, and the peak over frequency."""
    mean, x = result.peak.mean(), result.frequency
    loops = Panel([_loop(loop, f'{frequency:.0f} Hz', color, width) for (frequency, loop), color,
                   width in zip(result.loops.items(), ('sky', 'ink'), (4.0, 1.1))],
                  DELTA, CHARGE, 'film 32 x 3 mm, amplitude 8 mm')
    peaks = Panel([straight(x, 0.0, 'mean of all', 'shade', PC * mean),
                   dots(x, PC * result.peak, 'peak ± 2σ', 'blue', PC * result.sigma)],
                  'frequency [Hz]', 'charge peak [pC]', 'film 10 x 1 mm, amplitude 2 mm',
                  y_limits=(0.0, 1.3 * PC * mean))
    rest = Panel([straight(x, 0.0, '', 'shade'),
                  dots(x, 100.0 * (result.peak / mean - 1.0), '', 'blue',
                       100.0 * result.sigma / mean)],
                 'frequency [Hz]', 'deviation from the mean [%]')
    return section(
        'paper_a_fig_6', [[loops, peaks], [loops, rest]], (5.5, 2.5),
        {'same_loop': result.difference < SIGNIFICANCE_SIGMAS, 'constant': abs(
            result.slope) < max(MAX_FREQUENCY_SLOPE, SIGNIFICANCE_SIGMAS * result.slope_sigma)},
        difference=result.difference, spread=result.spread, slope=result.slope,
        slope_sigma=result.slope_sigma)


def amplitude_section(result: Proportionality) -> PaperSection:
    """Return Fig. 7: peaks over amplitude, and their deviation from a straight line."""
    x, (slope, offset) = MM * result.amplitude, result.line
    line = slope * result.amplitude + offset
    peaks = Panel([
        dots(x, PC * result.peak, 'bench ± 2σ', 'blue', PC * result.sigma),
        Mark(Curve(x, PC * line), 'regression line', width=1.0),
        *(Mark(Curve(x, PC * result.models[name]), label, color, width=1.2, dashed=dashed)
          for name, label, color, dashed in MODELS)], 'amplitude [mm]', 'charge peak [pC]')
    rest = Panel([
        straight(x, 0.0, '', 'blue'),
        dots(x, PC * (result.peak - line), '', 'blue', PC * result.sigma),
        Mark(Curve(x, PC * (result.models['exact'] - line)), MODELS[0][1], 'ink', width=1.2)],
        'amplitude [mm]', 'deviation from the line [pC]')
    (rise, sigma), exact = result.rise, result.exact_rise()
    return section(
        'paper_a_fig_7', [[peaks, rest]], (5.5, 4.6),
        {'straight': result.determination > MIN_LINE_R2,
         'curved': abs(rise - exact) < SIGNIFICANCE_SIGMAS * sigma},
        determination=result.determination, curvature=result.curvature, rise=rise, sigma=sigma,
        exact=exact, exact_to_quarter=result.exact_rise(0.5), first=x[0], last=x[-1],
        elastica_rise=result.elastica_rise, loop_rise=result.loop_rise,
        printed_excess=result.models['printed'][-1] / result.models['exact'][-1] - 1.0)


def fit_section(result: TableOneFits) -> PaperSection:
    """Return Fig. 8: measured and estimated loops, with the estimate's transient."""
    first = result.first
    shown = first.time < CYCLES
    x, estimated = -MM * first.deflection[shown], NC * first.estimated[shown]
    loop = Panel([
        Mark(Curve(x, NC * first.measured[shown]), 'bench', 'sky', width=3.0),
        Mark(Curve(x, estimated), 'estimated from the deflection', 'ink', width=0.9),
        replace(dots(x[:1], estimated[:1], 'zero initial condition', 'vermillion'), width=6.0)],
        DELTA, CHARGE)
    return section(
        'paper_a_fig_8', [[loop]], (7.5, 5.2),
        {'converges': first.settled > 0.0, 'agrees': first.determination > 0.99},
        first=first, cycles=first.settled * FREQUENCY, rms=NC * first.rms,
        stroke=result.printed_stroke, touching=TOUCHING_STROKE)


def comparison_section(result: TableOneFits) -> PaperSection:
    """Return Fig. 9: charge over time, and measured over estimated charge."""
    first = result.first
    shown, settled = first.time < CYCLES, first.time >= first.settled
    time, estimated, measured = first.time[shown], NC * first.estimated, NC * first.measured
    rest = (measured - estimated)[shown]
    over_time = Panel([Mark(Curve(time, measured[shown]), 'bench', 'sky', width=3.0),
                       Mark(Curve(time, estimated[shown]), 'estimated', 'ink', width=0.9)],
                      TIME_LABEL, CHARGE)
    difference = Panel([
        Mark(Curve(time, rest), '', 'vermillion', width=0.8),
        Mark(Curve(np.full(2, first.settled), np.array([rest.min(), rest.max()])), 'converged',
             'shade', width=1.0, dashed=True)], TIME_LABEL, 'difference [nC]')
    both = Panel([dots(estimated[settled], measured[settled], 'samples'),
                  straight(estimated[settled], 1.0, 'slope 1', 'ink')],
                 'estimated charge [nC]', 'bench charge [nC]')
    return section('paper_a_fig_9', [[over_time, both], [difference, both]], (5.5, 2.5),
                   {'slope': abs(first.slope - 1.0) < 0.01}, first=first)


def table_section(result: TableOneFits) -> PaperSection:
    """Return Table I, as a drawing: errors of the products."""
    seeds, panels = np.arange(1.0, len(result.estimates) + 1), []
    for name, symbol in zip(PRODUCTS, SYMBOLS):
        value, sigma = np.array([one[name] for one in result.estimates]).T / result.true[name]
        panels.append(Panel([straight(seeds, 0.0, '', 'ink'),
                             dots(seeds, 100.0 * (value - 1.0), '', 'blue', 100.0 * sigma)],
                            'recording', 'error [%], ± 2σ', symbol))
    scales, first = (1.0, NC, NC), result.estimates[0]
    pulls, (alpha, a, b) = np.abs(result.pulls), result.constants(0)
    return section(
        'paper_a_table_1', [panels], (3.7, 3.8),
        {'within': float(pulls.max()) < SIGNIFICANCE_SIGMAS},
        true=[scale * result.true[name] for name, scale in zip(PRODUCTS, scales)],
        first=[Uncertain(*(scale * part for part in first[name]))
               for name, scale in zip(PRODUCTS, scales)],
        gain=NC * TABLE_I_GAIN, geometric_gain=NC * result.geometric_gain,
        gain_ratio=TABLE_I_GAIN / result.geometric_gain, alpha=alpha / NC, a=a, b=b,
        recordings=len(result.estimates), products=pulls.size, one=np.mean(pulls < 1.0),
        two=np.mean(pulls < 2.0), largest=pulls.max())


def _loop(loop: Loop, label: str, color: str = 'blue', width: float = 1.4) -> Mark:
    closed = np.append(np.arange(loop.charge.size), 0)
    return Mark(Curve(-MM * loop.deflection[closed], NC * loop.charge[closed]), label, color,
                width=width)
