# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Report sections of paper B: printed and computed values, agreements and limitations."""

from __future__ import annotations

import numpy as np

from smart_tire.analysis.metrics import SlipScore
from smart_tire.reproduction import tire_maps
from smart_tire.reproduction.report import Section
from smart_tire.reproduction.tire_maps import (
    CRITICAL, METHODS, MIN_SLIP, MU, Outline, OUTLINE_SLIP, Signals, SLIPS, STIFFNESS, Sweep)
from smart_tire.reproduction.tire_runs import ROBOT, StiffnessFit

SIMULATED_ROBOT = (
    'The robot is simulated. The paper does not give its track, wheelbase, inertia, center of '
    'mass, motors and ground properties other than mu and C_x; they are assumed, so the slips '
    'agree with the paper in their pattern only.')
ASSUMED_GAIN = (
    'The gain in volts per unit charge is assumed, because the paper does not give an accurate '
    'one: amplitudes in volts cannot be compared.')
MAX_ZERO_SLIP = 0.05  # slip that counts as close to zero
MAX_SLIP_RMS = 0.03   # rms error of an estimate that agrees with the truth
MIN_LINE_R2 = 0.95    # R^2 of points that appear as a straight line in a graph
RELATIVE_TOLERANCE = 0.1
PAPER_STIFFNESS, PAPER_FRICTION = 52.7, 0.47  # N, -: Table I


def outline_section(result: Outline) -> Section:
    """Return the section on Fig. 8."""
    section = Section('paper_b_fig_8', 'Paper B, Fig. 8: one crossing of a film')
    read, state = result.read_height('fig8'), result.read_height('state')
    missing = 1e3 * tire_maps.OUTLINE_SPEED * (result.printed_interval - result.interval)
    shift = 1e3 * (tire_maps.OUTLINE_SPEED * result.interval - tire_maps.LENGTH)
    section.row('slip, wheel speed', 'schematic', f'{OUTLINE_SLIP}, 60 rpm')
    section.row('time in the patch', 'L / r w', f'{result.whole * 1e3:.1f} ms')
    section.row('peak to release', '(l + L - L_a) / r w',
                f'{result.printed_interval * 1e3:.1f} ms printed, '
                f'{result.interval * 1e3:.1f} ms exact')
    section.row('q_sm', 'B(25)',
                f'{result.printed_height:.3f} V printed, {result.height:.3f} V exact')
    section.check(abs(read / result.height - 1.0) < 0.01,
                  'With the release as drawn, the difference of the magnitudes of both peaks is '
                  f'q_sm ({read:.3f} V of {result.height:.3f} V).',
                  f'The difference of the magnitudes of both peaks is {read:.3f} V, not q_sm.')
    delay = 1e3 * (result.printed_interval - result.interval)
    section.limitation(
        f'The maximum of the stretch charge is {delay:.1f} ms later than in the paper: '
        f'x_m = L_a - l is {missing:.1f} mm too small, while sliding moves the peak by no more '
        f'than {shift:.1f} mm in total. At this slip B(25) is also '
        f'{1.0 - result.printed_height / result.height:.0%} too low.')
    section.limitation(
        'The opposite peak at release is drawn in the paper, but not derived. If charge is a '
        f'state it returns to the baseline, and the same reading gives {state:.2f} V, '
        f'{state / result.height:.1f} times q_sm.')
    section.limitation(ASSUMED_GAIN)
    return section


def slip_section(result: dict[str, dict[str, SlipScore]],
                 printed: dict[str, dict[str, SlipScore]]) -> Section:
    """Return the section on Fig. 10; the slips ``printed`` are those with B(7) as printed."""
    section = Section('paper_b_fig_10',
                      'Paper B, Fig. 10: slips at 120/60 rpm on concrete and sand')
    for ground, sides in result.items():
        for side, score in sides.items():
            section.row(f'{ground}, {side} side', 'graph',
                        f'{score.estimated_mean:+.3f}, truth {score.true_mean:+.3f}, rms error '
                        f'{score.error.rms:.3f}; with the printed B(7) '
                        f'{printed[ground][side].error.rms:.3f}')
    sand, right = result['sand'], result['concrete']['right'].estimated_mean
    both = [sand[side].estimated_mean for side in ('left', 'right')]
    worst = max(score.error.rms for sides in result.values() for score in sides.values())
    section.check(min(both) > 0.0,
                  f'On sand both sides have positive slip ({both[0]:+.2f} and {both[1]:+.2f}).',
                  'On sand at least one side does not have positive slip.')
    section.check(right < 0.0,
                  f'On concrete the slip of the right, slower side is negative ({right:+.2f}).',
                  'On concrete the slip of the right side is not negative.')
    section.check(worst < MAX_SLIP_RMS,
                  f'The estimates agree with the truth, with rms errors up to {worst:.3f}.',
                  f'The estimates deviate from the truth by up to {worst:.3f} rms.')
    section.check(abs(right) < MAX_ZERO_SLIP, 'It is close to zero, as in the paper.',
                  'The paper describes the slip of the right side on concrete as close to zero; '
                  f'here it is {right:+.2f}. It depends on track, wheelbase and center of mass, '
                  'which the paper does not give.')
    section.limitation('Ground truth of the simulation replaces the overhead camera, without '
                       'measurement errors. ' + SIMULATED_ROBOT)
    return section


def signal_section(result: Signals) -> Section:
    """Return the section on Fig. 11."""
    section = Section('paper_b_fig_11', 'Paper B, Fig. 11: film signals at 60/80 rpm')
    first, second = result.variation
    mean = result.peaks.mean(axis=0)
    section.row('peak voltage above the baseline, films 1 and 2', 'graph',
                f'{mean[0]:.2f} V and {mean[1]:.2f} V on average')
    section.row('its range over the revolutions', 'varies (graph)',
                f'{first:.0%} and {second:.0%}')
    section.row('delay of film 2', '30 mm on the wheel',
                f'{result.lag * 1e3:.1f} ms ({result.expected_lag * 1e3:.1f} ms for 30 mm)')
    section.row('bump before the patch', 'graph', f'{result.bump * 1e3:.0f} mV of opposite sign')
    section.check(min(first, second) > RELATIVE_TOLERANCE,
                  f'The peaks vary between revolutions (by {first:.0%} and {second:.0%} of their '
                  'mean) and the films differ in amplitude.', 'The peaks hardly vary.')
    section.check(result.bump > 0.0, 'One revolution has the waveform of Fig. 8 with a bump of '
                  'opposite sign before and after the patch.', 'There is no bump.')
    section.check(abs(result.lag / result.expected_lag - 1.0) < RELATIVE_TOLERANCE,
                  'The second film repeats the first with the delay of their distance.',
                  'The delay between the films does not agree with their distance.')
    section.limitation('Variation and bumps are inputs of the simulation, with sizes taken from '
                       'the graph in the paper; there is no theory of them. ' + ASSUMED_GAIN)
    return section


def stretch_section(result: Sweep) -> Section:
    """Return the section on Fig. 12."""
    section = Section('paper_b_fig_12', 'Paper B, Fig. 12: stretch charge over slip')
    crossings = result.crossings
    for speed, line in result.lines.items():
        section.row(f'{speed:.0f} rpm: slope of q_sm over slip', 'graph',
                    f'{line.slope:.2f} V per unit slip, R^2 {line.determination:.3f}')
    error = crossings.raw_stretch - crossings.stretch
    bias, scatter = float(np.nanmean(error)), float(np.nanstd(error))
    low = [float(1.0 - tire_maps.printed_stretch(slip) / tire_maps.exact_stretch(slip))
           for slip in (0.1, 0.3)]
    slopes = [line.slope for line in result.lines.values()]
    section.row('raw samples minus fitted waveform', '-',
                f'{bias * 1e3:+.0f} mV on average, scatter {scatter * 1e3:.0f} mV')
    section.row('B(25) below the exact q_sm at slip 0.1 and 0.3', '-',
                f'{low[0]:.0%} and {low[1]:.0%}')
    height = float(np.nanmedian((crossings.stretch / crossings.true_stretch)[
        crossings.true_total_slip > MIN_SLIP]))
    section.row('fitted waveform over the exact q_sm at its combined slip', '-',
                f'{height:.3f} (median)')
    worst = min(line.determination for line in result.lines.values())
    section.check(worst > MIN_LINE_R2,
                  f'The charge is nearly linear in slip (R^2 at least {worst:.3f}).',
                  f'The charge is not linear in slip (R^2 {worst:.3f}).')
    ratio = max(slopes) / min(slopes) - 1.0
    section.check(ratio < RELATIVE_TOLERANCE,
                  f'Both wheel speeds have the same slope within {ratio:.0%}.',
                  'The wheel speeds have different slopes.')
    section.check(abs(bias) < 0.01, 'Raw samples agree with the fitted waveform.',
                  f'Taken from raw samples as in the paper, q_sm has a bias of {bias * 1e3:+.0f} '
                  f'mV and a scatter of {scatter * 1e3:.0f} mV, because sampling at 400 Hz misses '
                  'the sharp minimum.')
    section.limitation('The points are below the exact curve of the figure, which is for purely '
                       'longitudinal slip: in these turns the wheels slip laterally as well. They '
                       f'are at {height:.3f} of the exact value for their combined slip.')
    section.limitation(f'{len(result.braking)} crossings with negative slip are excluded: two '
                       'peaks exist in traction only. ' + ASSUMED_GAIN)
    return section


def adhesion_section(result: Sweep) -> Section:
    """Return the section on Fig. 13."""
    section = Section('paper_b_fig_13', 'Paper B, Fig. 13: adhesion ratio over slip')
    exact, printed, paper = (result.slopes[method] for method in METHODS)
    excess = tire_maps.printed_excess(SLIPS)
    section.row('slope of B(22)', 'small, negative', f'{-1.0 / CRITICAL:.2f} per unit slip')
    section.row('slope, exact map', '-', f'{exact.slope:.2f}')
    section.row('slope, printed map of the same peaks', '-', f'{printed.slope:.2f}')
    section.row('slope, raw peaks and printed map', 'almost constant (graph)',
                f'{paper.slope:.2f}, R^2 {paper.determination:.2f}')
    section.row('mu of the printed map over the true one, without noise', '-',
                f'{excess.min():.1f} to {excess.max():.1f}')
    section.check(abs(paper.slope) < 0.6 / CRITICAL,
                  'With the method of the paper, the ratio decreases only '
                  f'{abs(paper.slope) * CRITICAL:.0%} as fast as B(22), with scatter: almost '
                  'constant, as in the paper.',
                  'With the method of the paper, the ratio decreases like B(22).')
    section.check(abs(exact.slope * CRITICAL + 1.0) < RELATIVE_TOLERANCE,
                  f'The exact map of the same peaks agrees with B(22): slope {exact.slope:.2f}, '
                  f'expected {-1.0 / CRITICAL:.2f}.',
                  f'The exact map does not agree with B(22): slope {exact.slope:.2f}.')
    section.limitation('Scatter and sampling are not the only reasons for the small slope of '
                       'Fig. 13, as the paper assumes: L_a = L + l - r w dt_a itself reduces it, '
                       f'and gives a mu {excess.min():.1f} to {excess.max():.1f} times too large '
                       f'at slips up to {SLIPS[-1]:.1f}, without any noise.')
    section.limitation(f'Slopes, and mu in Table I, exclude total slips below {MIN_SLIP}: there '
                       'almost nothing slides, and a crossing hardly determines the peak.')
    section.limitation('In a turn a wheel also slips laterally; the adhesion length depends on '
                       'the total slip (right panel), which the paper does not consider. '
                       + SIMULATED_ROBOT)
    return section


def table_section(result: Sweep, fit: StiffnessFit) -> Section:
    """Return the section on Table I."""
    section = Section('paper_b_table_1', 'Paper B, Table I: stiffness and friction')
    tire, film = ROBOT.tire, ROBOT.film
    for name, paper, here in (('l', 20, film.length), ('b', 3, film.width),
                              ('B', 89, tire.contact_width), ('L', 46, tire.contact_length),
                              ('r', 87, ROBOT.wheel_radius)):
        section.row(f'{name} [mm], input', f'{paper}', f'{here * 1e3:.0f}')
    section.row('mass [kg], input', '10.9', f'{ROBOT.mass}')
    section.row('C_x from accelerations', f'{PAPER_STIFFNESS} N',
                f'{fit.stiffness:.1f} ± {fit.sigma:.1f} N (input: {STIFFNESS} N)')
    median = {method: float(np.nanmedian(result.friction[method])) for method in METHODS}
    labels = ('mu, exact map and total slip', 'mu, printed map and total slip',
              'mu as in the paper: raw peaks, longitudinal slip')
    for method, label in zip(METHODS, labels):
        low, high = np.nanpercentile(result.friction[method], [16, 84])
        section.row(label, f'{PAPER_FRICTION}' if method == 'paper' else '-',
                    f'median {median[method]:.2f}, 68 % interval {low:.2f} to {high:.2f} '
                    f'(input: {MU})')
    per_speed = [float(np.nanmedian(result.friction['paper'][result.crossings.speed == speed]))
                 for speed in result.lines]
    deviation = abs(fit.stiffness / STIFFNESS - 1.0)
    section.check(deviation < RELATIVE_TOLERANCE,
                  f'C_x from the accelerations of a straight drive agrees within {deviation:.1%}.',
                  'C_x from the accelerations does not agree with the input.')
    section.check(abs(median['exact'] / MU - 1.0) < RELATIVE_TOLERANCE,
                  f'mu of the exact map agrees: {median["exact"]:.2f}, input {MU}.',
                  f'mu of the exact map does not agree: {median["exact"]:.2f}, input {MU}.')
    values = f'({per_speed[0]:.2f} and {per_speed[1]:.2f})'
    section.check(abs(per_speed[0] / per_speed[1] - 1.0) < 2.0 * RELATIVE_TOLERANCE,
                  'As in the paper, its method gives similar values at both wheel speeds '
                  f'{values}.',
                  f'The method of the paper gives different values at both wheel speeds {values}.')
    section.limitation(
        'The agreement of both speeds does not validate the method: the printed map gives '
        f'{median["printed"] / MU:.1f} times the true mu with fitted peaks, and '
        f'{median["paper"] / MU:.1f} times with raw peaks and longitudinal slip (the missing '
        'lateral slip compensates a part). If this held for the data of the paper, its '
        f'{PAPER_FRICTION} would correspond to about '
        f'{PAPER_FRICTION * MU / median["paper"]:.2f}.')
    section.check(abs(fit.stiffness - STIFFNESS) < 3.0 * fit.sigma,
                  'The error of C_x is within three standard errors.',
                  'The error of C_x exceeds three standard errors.')
    section.limitation(
        f'The true slip lags by {fit.lag * 1e3:.1f} ms, fitted with C_x: the forces in a step of '
        'the simulation, of one millisecond, result from the speed over ground at its start. '
        'Without that lag C_x would be 2.6 % larger.')
    return section
