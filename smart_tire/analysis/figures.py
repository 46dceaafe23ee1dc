# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of friction, ground and one patch crossing, and the files of all figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import math
from pathlib import Path

import numpy as np

from smart_tire.analysis.crossing import crossing_waveform, CrossingWaveform
from smart_tire.analysis.drawing import save_all
from smart_tire.analysis.figure import (
    Curve, Figure, interrupted, limits, Mark, outside_caption, PAIR, Panel, reference_caption,
    TIME_LABEL, TRUTH, truth_marks, TWO_SIGMA)
from smart_tire.analysis.friction_metrics import (
    column, is_informative, kind_of, MAX_RELATIVE_SIGMA, of_wheel, stamps_of)
from smart_tire.analysis.motion_figures import ESTIMATE, path_figure, slip_figure
from smart_tire.analysis.result import Result
from smart_tire.estimates import at
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays, seconds
from smart_tire.samples import Friction, WHEELS

MAX_FRICTION = 1.2      # upper end of the friction axis
MAX_CROSSING_GAP = 5.0  # s between two crossings, over which no line is drawn
DASHED = reference_caption([TRUTH])
SINGLE = 'single crossing ± 2σ'


def write_figures(directory: Path, result: Result, robot: RobotParams) -> list[Path]:
    """Draw slip, path, friction and one crossing, where available; return the files."""
    return save_all((slip_figure(result), path_figure(result), friction_figure(result),
                     crossing_figure(result, robot)), directory)


def friction_marks(single: Curve, fused: Curve, truth: Curve) -> list[Mark]:
    """Return single estimates with bars, fused ones with a band, and the truth."""
    return [Mark(single, SINGLE, 'orange', 'points', 4.0), Mark(fused, 'fused ± 2σ', width=1.6),
            *truth_marks(truth, 'mid')]


def _curve(crossings: Sequence[Friction], name: str, origin_ns: int) -> Curve:
    """Return a quantity of ``crossings``; uninformative single estimates are NaN."""
    value, sigma = column(crossings, name), column(crossings, name, sigmas=True)
    if name == 'friction_coefficient_single':
        value[~is_informative(value, sigma)] = math.nan
    return Curve(seconds(stamps_of(crossings), origin_ns), value, sigma)


def _crossing_panels(result: Result, label: str, top: float,
                     marks: Callable[[Sequence[Friction], Sequence[Friction]], list[Mark]]
                     ) -> list[list[Panel]]:
    """Return a panel of each wheel with crossings, with ``marks`` of its own and true ones."""
    return [[Panel(marks(own, of_wheel(result.truth.crossings, wheel)), TIME_LABEL, label,
                   wheel.replace('_', ' '), y_limits=(0.0, top))]
            for wheel in WHEELS if (own := of_wheel(result.estimates.crossings, wheel))]


def friction_figure(result: Result) -> Figure | None:
    """Return friction per crossing, one panel per instrumented wheel; None without crossings."""
    def marks(own: Sequence[Friction], true: Sequence[Friction]) -> list[Mark]:
        return friction_marks(
            _curve(own, 'friction_coefficient_single', result.origin_ns),
            *(interrupted(_curve(several, 'friction_coefficient', result.origin_ns),
                          MAX_CROSSING_GAP) for several in (own, true)))

    rows = _crossing_panels(result, 'friction coefficient [-]', MAX_FRICTION, marks)
    single = np.concatenate([np.empty(0), *(panel.marks[0].curve.y for panel, in rows)])
    return Figure(
        'friction', 'Friction coefficient per patch crossing of each instrumented wheel',
        'Sliding friction coefficient. Points: single patch crossings; line: fused with the '
        f'crossings before. Bands and bars: {TWO_SIGMA}{DASHED if result.truth.crossings else ""} '
        f'Not drawn: {np.isnan(single).sum()} of {len(single)} single crossings that are '
        f'uninformative (σ above {100.0 * MAX_RELATIVE_SIGMA:.0f} % of the value).'
        + outside_caption([single], 0.0, MAX_FRICTION),
        rows, (9.0, 2.6), result.segments) if rows else None


def adhesion_figure(result: Result) -> Figure | None:
    """Return the adhesion ratio of each instrumented wheel; None without crossings."""
    def marks(own: Sequence[Friction], true: Sequence[Friction]) -> list[Mark]:
        first, second = (_curve(several, 'adhesion_ratio', result.origin_ns)
                         for several in (own, true))
        return [Mark(first, SINGLE, 'orange', 'points', 4.0),
                *truth_marks(interrupted(second, MAX_CROSSING_GAP))]

    rows = _crossing_panels(result, 'adhesion ratio [-]', 1.1, marks)
    return Figure(
        'adhesion', 'Adhesion ratio per patch crossing of each instrumented wheel',
        'Share of the contact patch in which the tread adheres to the ground: 1 without sliding. '
        f'Bars: {TWO_SIGMA}{DASHED if result.truth.crossings else ""}', rows) if rows else None


def ground_figure(result: Result) -> Figure | None:
    """Return stiffness and rolling resistance of the ground; None without."""
    ground, crossings = result.estimates.grounds(), result.truth.crossings
    true = _curve(sorted(crossings, key=lambda one: one.stamp_ns), 'stiffness', result.origin_ns)
    time, rows = seconds(ground.stamp_ns, result.origin_ns), []
    for one, label, title, truth in (
            (ground.stiffness, 'C_x [N]', 'longitudinal stiffness', truth_marks(true, 'post')),
            (ground.rolling_resistance, 'rolling resistance [-]', 'rolling resistance', [])):
        own = interrupted(Curve(time, one.value, one.sigma), MAX_CROSSING_GAP)
        rows.append([Panel([Mark(own, ESTIMATE), *truth], TIME_LABEL, label, title,
                           y_limits=limits([own.y - own.reach, own.y + own.reach], 0.01))])
    return Figure(
        'ground', 'Stiffness and rolling resistance of the ground over time',
        'Longitudinal stiffness C_x of a tire on the present ground, and rolling resistance as a '
        f'share of the load. Bands: {TWO_SIGMA}{DASHED if crossings else ""}',
        rows) if len(time) else None


def waveform_marks(waveform: CrossingWaveform) -> list[Mark]:
    """Return samples, model and time in the patch of each film, as in paper B, Fig. 11(b)."""
    every = np.concatenate([film.volts for film in waveform.films])
    top, bottom = float(every.max()), float(every.min())
    found = [Mark(Curve(np.zeros(2), np.array([bottom, top])), 'crossing', 'shade', width=1.0,
                  dashed=True)]
    inside = np.array([-waveform.reach, waveform.reach])
    for row, (film, color) in enumerate(zip(waveform.films, PAIR * len(waveform.films))):
        name, height = f'film {film.film + 1}', top + (top - bottom) * (0.12 - 0.05 * row)
        found += [
            Mark(Curve(waveform.time_ms(film, film.position), film.volts), f'{name}, samples',
                 color, 'points', 4.0),
            Mark(Curve(waveform.time_ms(film, film.model_position), film.model_volts),
                 f'{name}, model', color),
            Mark(Curve(waveform.time_ms(film, inside), np.full(2, height)),
                 f'{name} in the patch', color, width=5.0, opacity=0.55)]
    return found


def crossing_figure(result: Result, robot: RobotParams) -> Figure | None:
    """Return a typical crossing with its waveform; None without."""
    waveform = next((found for one in typical_crossings(result.estimates.crossings)
                     if (found := recorded_waveform(one, result.inputs, robot)) is not None
                     and found.complete), None)
    return None if waveform is None else Figure(
        'crossing', 'Film voltages during one patch crossing',
        'Samples of the films of one wheel, and the model for the estimated slip and adhesion; '
        'its bending peak and the places of the films are fitted. Bars: time in which a film '
        'overlaps the contact patch, from the wheel speed and the contact length. The crossing is '
        'where the center between the films is at the center of the patch.',
        [[Panel(waveform_marks(waveform), 'time after the crossing [ms]', 'amplifier output [V]',
                f'one crossing of {waveform.wheel.replace("_", " ")}')]])


def typical_crossings(crossings: Sequence[Friction]) -> Iterator[Friction]:
    """Yield crossings in traction, else of any known slip, nearest to the median slip first."""
    candidates = [p for p in crossings if kind_of(p) == 'traction'] or [
        p for p in crossings if np.isfinite(p.slip.value)]
    if candidates:
        slips = column(candidates, 'slip')
        yield from (candidates[i] for i in np.argsort(np.abs(slips - np.median(slips))))


def recorded_waveform(crossing: Friction, inputs: SampleArrays,
                      robot: RobotParams) -> CrossingWaveform | None:
    """Return the voltages around ``crossing``; None without samples or wheel speed."""
    speeds_ns, speeds = inputs.speeds()
    if crossing.wheel not in inputs.film_wheels():
        return None
    omega = at(np.array([crossing.stamp_ns]), speeds_ns, speeds)[0, WHEELS.index(crossing.wheel)]
    return crossing_waveform(crossing, *inputs.films(crossing.wheel), float(omega), robot)
