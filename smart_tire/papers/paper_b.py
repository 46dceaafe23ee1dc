# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sections of paper B."""

from __future__ import annotations

from collections.abc import Mapping
import math

import numpy as np

from smart_tire.analysis.figure import (
    CAMERA, Curve, dots, Mark, Panel, straight, TIME_LABEL, TRUTH, truth_marks)
from smart_tire.analysis.figures import crossing_figure
from smart_tire.analysis.metrics import rms, SlipScore
from smart_tire.analysis.motion_figures import side_marks, slip_curves
from smart_tire.analysis.overhead import frame_panel
from smart_tire.analysis.result import Comparison, Result
from smart_tire.arrays import Array
from smart_tire.papers import tire_maps
from smart_tire.papers.report import PaperSection, section
from smart_tire.papers.tire_maps import (
    CRITICAL, METHODS, MIN_SLIP, MU, Outline, OUTLINE_SLIP, OUTLINE_SPEED, Signals, SLIPS,
    STIFFNESS, Sweep)
from smart_tire.papers.tire_runs import AccelerationFit, Drive, ROBOT, side_slips, View
from smart_tire.samples import NS_PER_S

MAX_ZERO_SLIP = 0.05  # slip that counts as close to zero
MAX_SLIP_RMS = 0.03   # rms error of an estimate that agrees with the truth
MAX_PATH_RMS = 5.0    # mm, rms error of a path by the camera that agrees with the truth
WITHIN_TWO = 0.95     # share of Gaussian errors below two standard deviations
MIN_LINE_R2 = 0.95    # R^2 of points that appear as a straight line in a graph
RELATIVE_TOLERANCE = 0.1
PAPER_FRICTION = 0.47  # Table I
MILLI = 1e3            # from SI units
CURVE_POINTS = 60
SPEED_COLORS = {60.0: 'blue', 80.0: 'orange'}
METHOD_MARKS = {'exact': ('exact map', 'blue'), 'printed': ('printed map', 'orange'),
                'paper': ('printed map, raw peaks, longitudinal slip', 'shade')}
RATIO, SLIP = r'adhesion ratio $\xi_a$ [-]', 'slip ratio [-]'


def outline_section(found: Outline) -> PaperSection:
    """Return Fig. 8: the parts of one crossing and their sum, in both release conventions."""
    read, state = found.read_height('fig8'), found.read_height('state')
    spans = ((found.whole, r'$\Delta t_L$', 'shade'),
             (found.interval, r'$\Delta t_a$ exact', 'green'),
             (found.printed_interval, r'$\Delta t_a$ printed', 'purple'))
    low = float((found.bending['fig8'] + found.stretch).min())
    intervals = [Mark(Curve(MILLI * np.array([found.whole - length, found.whole]),
                            np.full(2, low - 0.15 * row)), label, color, width=3.0)
                 for row, (length, label, color) in enumerate(spans, 1)]
    panels = [Panel([
        Mark(Curve(MILLI * found.time, found.bending[release]), 'bending', 'orange', dashed=True),
        Mark(Curve(MILLI * found.time, found.stretch), 'stretching', 'sky', dashed=True),
        Mark(Curve(MILLI * found.time, found.bending[release] + found.stretch), 'sum', 'ink'),
        *(intervals if release == 'fig8' else ())],
        'time since the film is fully in the patch [ms]', 'above the baseline [V]', title)
        for release, title in (('fig8', 'release as drawn in Fig. 8'),
                               ('state', 'release with charge as a state'))]
    delay = found.printed_interval - found.interval
    return section(
        'paper_b_fig_8', [panels], (5.5, 4.4), {'read': abs(read / found.height - 1.0) < 0.01},
        found=found, slip=OUTLINE_SLIP, whole=MILLI * found.whole, read=read, state=state,
        interval=MILLI * found.interval, printed_interval=MILLI * found.printed_interval,
        delay=MILLI * delay, missing=MILLI * OUTLINE_SPEED * delay,
        shift=MILLI * (OUTLINE_SPEED * found.interval - tire_maps.LENGTH),
        low=1.0 - found.printed_height / found.height, state_ratio=state / found.height)


def view_section(view: View, run: Drive) -> PaperSection:
    """Return Fig. 9: the first image of the overhead camera, and the path in it."""
    found, errors = view.found, Comparison(view.estimates, run.truth).poses.error
    position = MILLI * rms(np.linalg.norm(errors[:, :2], axis=1))
    return section('paper_b_fig_9', [[frame_panel(found, view.params)]], (9.0, 5.2), {
        'all_used': found.published == found.images, 'path': position < MAX_PATH_RMS},
        used=found.published, images=found.images, position=position,
        yaw=math.degrees(rms(errors[:, 2])))


def slip_section(runs: Mapping[str, Drive], views: Mapping[str, View],
                 slips: Mapping[str, Mapping[str, SlipScore]],
                 printed: Mapping[str, Mapping[str, SlipScore]]) -> PaperSection:
    """
    Return Fig. 10: slips of both sides on two grounds, with those of the camera and the truth.

    Of ``slips``, by ground and side, ``printed`` are those with B(7) as printed.
    """
    panels = [Panel(side_marks(slip_curves(
        run.estimates, {TRUTH: run.truth, CAMERA: views[ground].estimates}, run.origin_ns)),
        TIME_LABEL, SLIP, ground, (0.0, (run.end_ns - run.origin_ns) / NS_PER_S), (-0.3, 0.5))
        for ground, run in runs.items()]
    seen = {ground: side_slips(run, views[ground].estimates) for ground, run in runs.items()}
    by_camera = {ground: side_slips(run, run.estimates, views[ground].estimates)
                 for ground, run in runs.items()}
    camera, apart = (max(score.error.rms for sides in several.values()
                         for score in sides.values()) for several in (seen, by_camera))
    inside = min(score.error.within_two for sides in by_camera.values()
                 for score in sides.values())
    sand, right = slips['sand'], slips['concrete']['right'].estimated_mean
    worst = max(score.error.rms for sides in slips.values() for score in sides.values())
    return section(
        'paper_b_fig_10', [panels], (5.5, 3.6), {
            'both_positive': min(side.estimated_mean for side in sand.values()) > 0.0,
            'negative': right < 0.0, 'agree': worst < MAX_SLIP_RMS,
            'near_zero': abs(right) < MAX_ZERO_SLIP,
            'camera': camera < 0.5 * worst, 'both_sigmas': inside >= WITHIN_TWO},
        **slips, printed=printed, worst=worst, seen=seen, camera=camera, apart=apart,
        inside=100.0 * inside)


def signal_section(result: Signals, run: Drive) -> PaperSection:
    """Return Fig. 11: the film voltages over the drive, and in one crossing."""
    crossing = crossing_figure(Result(run.estimates, run.inputs), ROBOT)
    contact = [] if crossing is None else crossing.panels
    films = [Panel([Mark(Curve(result.time, volts), '', color, width=0.6)], TIME_LABEL,
                   f'film {number} [V]', '', (0.0, float(result.time[-1])),
                   (0.0, ROBOT.film.voltage_range))
             for number, (volts, color) in enumerate(zip(result.volts.T, ('blue', 'orange')), 1)]
    variation = result.variation
    return section(
        'paper_b_fig_11', [[film, *contact] for film in films], (6.0, 2.7), {
            'vary': min(variation) > RELATIVE_TOLERANCE, 'bump': result.bump > 0.0,
            'delay': abs(result.lag / result.expected_lag - 1.0) < RELATIVE_TOLERANCE},
        peaks=result.peaks.mean(axis=0), variation=variation, lag=MILLI * result.lag,
        expected_lag=MILLI * result.expected_lag, bump=MILLI * result.bump)


def stretch_section(result: Sweep) -> PaperSection:
    """Return Fig. 12: q_sm over slip for two wheel speeds."""
    crossings = result.crossings
    slips = _slips(crossings.slip)
    marks = [dots(crossings.slip, crossings.raw_stretch, 'from raw samples', 'shade')]
    for speed, line in result.lines.items():
        own, color = crossings.take(crossings.speed == speed), SPEED_COLORS[speed]
        marks += [dots(own.slip, own.stretch, f'{speed:.0f} rpm ± 2σ', color, own.stretch_sigma),
                  straight(slips, line.slope, f'line, {speed:.0f} rpm', color, line.offset)]
    exact, printed = tire_maps.exact_stretch(slips), tire_maps.printed_stretch(slips)
    marks += [Mark(Curve(slips, exact), 'exact, longitudinal slip', 'ink'),
              Mark(Curve(slips, printed), 'B(25) with its $L_a$', 'vermillion', dashed=True)]
    error = MILLI * (crossings.raw_stretch - crossings.stretch)
    bias, lines = float(np.nanmean(error)), list(result.lines.values())
    slopes, worst = [line.slope for line in lines], min(line.determination for line in lines)
    ratio = max(slopes) / min(slopes) - 1.0
    tested = np.array([0.1, 0.3])
    return section(
        'paper_b_fig_12', [[Panel(marks, SLIP, '$q_{sm}$ [V]', y_limits=(-0.05, None))]],
        (8.0, 5.2), {'linear': worst > MIN_LINE_R2, 'same_slope': ratio < RELATIVE_TOLERANCE,
                     'raw_agrees': abs(bias) < 10.0},
        slow=result.lines[60.0], fast=result.lines[80.0], worst=worst, ratio=ratio, bias=bias,
        scatter=float(np.nanstd(error)), braking=len(result.braking),
        low=1.0 - tire_maps.printed_stretch(tested) / tire_maps.exact_stretch(tested),
        height=float(np.nanmedian((crossings.stretch / crossings.true_stretch)[
            crossings.true_total_slip > MIN_SLIP])))


def adhesion_section(result: Sweep) -> PaperSection:
    """Return Fig. 13: adhesion ratio over slip: exact, printed, and the paper's method."""
    crossings, ratios, slopes = result.crossings, result.ratios, result.slopes
    slips = _slips(crossings.total_slip)
    models = [straight(slips, -1.0 / CRITICAL, f'B(22), μ = {MU}', 'ink', 1.0),
              Mark(Curve(slips, tire_maps.printed_ratio(slips)), 'printed map of exact peaks',
                   'vermillion', dashed=True)]
    by_speed = [dots(crossings.slip[own], ratios['paper'][own], f'{speed:.0f} rpm', color)
                for speed, color in SPEED_COLORS.items() for own in [crossings.speed == speed]]
    by_map = [dots(crossings.total_slip, ratios[method], f'{label}, fitted peaks', color)
              for method, (label, color) in METHOD_MARKS.items() if method != 'paper']
    limits = (0.0, slips[-1]), (0.6, 1.1)
    panels = [
        Panel([*by_speed, *models], SLIP, RATIO, 'method of the paper: raw peaks, printed map',
              *limits),
        Panel([*by_map, *models], 'total slip [-]', RATIO, 'the same crossings, fitted waveforms',
              *limits)]
    share, excess = abs(slopes['paper'].slope) * CRITICAL, tire_maps.printed_excess(SLIPS)
    return section(
        'paper_b_fig_13', [panels], (6.0, 4.4),
        {'flat': share < 0.6,
         'exact_agrees': abs(slopes['exact'].slope * CRITICAL + 1.0) < RELATIVE_TOLERANCE},
        **slopes, model=-1.0 / CRITICAL, share=share, least=excess.min(), most=excess.max())


def table_section(result: Sweep, fit: AccelerationFit) -> PaperSection:
    """Return Table I, as drawings: forces for C_x, and friction by method."""
    tire, film, crossings, friction = ROBOT.tire, ROBOT.film, result.crossings, result.friction
    forces = Panel([dots(fit.effective, fit.force, 'straight drive'),
                    straight(fit.effective, fit.stiffness, f'$C_x$ = {fit.stiffness:.1f} N',
                             'ink')],
                   'slip times brush shape, without mean [-]', 'force per wheel [N]')
    slips = _slips(crossings.total_slip)
    by_method = Panel([*(dots(crossings.total_slip, friction[method], label, color)
                         for method, (label, color) in METHOD_MARKS.items()),
                       *truth_marks(straight(slips, 0.0, offset=MU).curve)],
                      'total slip [-]', 'friction coefficient [-]', y_limits=(0.0, 1.6))
    interval = {method: np.nanpercentile(friction[method], [16, 50, 84]) for method in METHODS}
    median = {method: values[1] for method, values in interval.items()}
    slow, fast = (float(np.nanmedian(friction['paper'][crossings.speed == speed]))
                  for speed in result.lines)
    deviation = abs(fit.stiffness / STIFFNESS - 1.0)
    return section(
        'paper_b_table_1', [[forces, by_method]], (5.5, 4.0), {
            'stiffness': deviation < RELATIVE_TOLERANCE,
            'friction': abs(median['exact'] / MU - 1.0) < RELATIVE_TOLERANCE,
            'both_speeds': abs(slow / fast - 1.0) < 2.0 * RELATIVE_TOLERANCE,
            'within_errors': abs(fit.stiffness - STIFFNESS) < 3.0 * fit.sigma},
        **interval, fit=fit, stiffness=STIFFNESS, mu=MU, deviation=deviation, slow=slow, fast=fast,
        length=MILLI * film.length, width=MILLI * film.width, mass=ROBOT.mass,
        contact_width=MILLI * tire.contact_width, contact_length=MILLI * tire.contact_length,
        radius=MILLI * ROBOT.wheel_radius, printed_excess=median['printed'] / MU,
        paper_excess=median['paper'] / MU, corrected=PAPER_FRICTION * MU / median['paper'],
        lag=MILLI * fit.lag)


def _slips(values: Array) -> Array:
    """Return slips [-] from 0 beyond the largest of ``values``, where these are known."""
    return np.linspace(0.0, 1.1 * float(np.nanmax(values)), CURVE_POINTS)
