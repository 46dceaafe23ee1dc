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

"""Film voltages over time, and those of the latest patch crossing with the fitted waveform."""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np
import rerun as rr

from smart_tire.arrays import Array
from smart_tire.estimation.friction.estimator import EvaluatedCrossing, FrictionEstimator
from smart_tire.estimation.friction.fitted_waveform import fitted_waveforms
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import Friction, Sample, TireSample
from smart_tire.uncertain import Uncertain
from smart_tire.view.recorder import finite, Recorder, Track
from smart_tire.view.style import AXIS, FILM_COLORS

BLOCK = 20           # samples that are thinned together
RESTING_RANGE = 0.03  # V, range of a block in which nothing but noise is
MAX_PERIODS = 4      # of samples; a longer interval is a gap
MM_PER_M = 1e3
MM_PER_V = 30.0      # vertical scale of a crossing
REACH = 60.0         # mm, on either side of the center of the patch
VOLTS = np.arange(-1.5, 1.6, 0.5)   # V, ticks
PLACES = np.arange(-60.0, 61.0, 30.0)  # mm, ticks

OnChange = Callable[[Friction], None]


class FilmLayer:
    """
    Raw voltages of the films.

    Of blocks without any signal only the lowest and the highest sample are kept; all others are
    complete. A gap between samples interrupts the line.
    """

    def __init__(self, recorder: Recorder, period_ns: int) -> None:
        self._recorder, self._max_gap_ns = recorder, MAX_PERIODS * period_ns
        self._blocks: dict[tuple[str, int], list[tuple[int, float]]] = {}

    def add(self, sample: TireSample) -> None:
        """Add the voltages of one conversion."""
        for film, volts in enumerate(sample.volts):
            block = self._blocks.setdefault((sample.wheel, film), [])
            if block and not 0 < sample.stamp_ns - block[-1][0] <= self._max_gap_ns:
                self._send(sample.wheel, film, interrupted=True)
            block.append((sample.stamp_ns, volts))
            if len(block) == BLOCK:
                self._send(sample.wheel, film)

    def finish(self) -> None:
        """Send what is left, at the end of the recording."""
        for wheel, film in self._blocks:
            self._send(wheel, film)

    def _send(self, wheel: str, film: int, *, interrupted: bool = False) -> None:
        block = self._blocks[wheel, film]
        track = self._track(wheel, film)
        for stamp_ns, volts in thinned(block):
            track.add(stamp_ns, volts)
        if interrupted:
            track.add(block[-1][0] + 1, math.nan)
        block.clear()

    def _track(self, wheel: str, film: int) -> Track:
        return self._recorder.line(
            f'films/{wheel}/film_{film + 1}', f'film {film + 1} [V]',
            FILM_COLORS[film % len(FILM_COLORS)], width=1.0)


def thinned(block: list[tuple[int, float]]) -> list[tuple[int, float]]:
    """Return all samples of a block with a signal, otherwise the lowest and the highest."""
    if not block:
        return []
    low, high = (choose(block, key=lambda sample: sample[1]) for choose in (min, max))
    return block if high[1] - low[1] > RESTING_RANGE else sorted({low, high})


class CrossingLayer:
    """
    The latest crossing of each wheel: voltages over the position of the film, and their fit.

    The fits are those of a friction estimator in this program, with the same inputs and
    parameters as the node: recordings do not contain them.
    """

    def __init__(self, recorder: Recorder, params: FrictionEstimatorParams,
                 on_change: OnChange) -> None:
        self._recorder, self._robot, self._on_change = recorder, params.robot, on_change
        self._estimator = FrictionEstimator(params, self._show)
        self.fits = 0
        for wheel in params.robot.film.wheels:
            draw_axes(recorder, f'contact/{wheel}', params.robot)

    def add(self, sample: Sample) -> None:
        """Add a sample of one of the inputs of the friction estimator."""
        self._estimator.update(sample)

    def finish(self) -> None:
        """Show the last crossings, at the end of the recording."""
        self._estimator.finish()

    def _show(self, crossing: EvaluatedCrossing) -> None:
        friction = crossing.friction
        if crossing.surface_changed:
            self._on_change(friction)
        base, stamp_ns = f'contact/{friction.wheel}', friction.stamp_ns
        waveforms = [] if crossing.waveform is None else fitted_waveforms(
            crossing.waveform, self._robot, friction.wheel)
        self.fits += bool(waveforms)
        colors = [FILM_COLORS[one.film % len(FILM_COLORS)] for one in waveforms]
        counts = [len(one.position) for one in waveforms]
        if waveforms:  # otherwise the last ones remain
            # one entity, so that samples and fit are always those of the same crossing
            self._recorder.shape(f'{base}/waveforms', stamp_ns, rr.Points2D(
                np.concatenate([_plot(one.position, one.volts) for one in waveforms]),
                colors=np.repeat(np.array(colors, np.uint8).reshape(-1, 3), counts, axis=0),
                radii=rr.Radius.ui_points(2.5)), rr.LineStrips2D(
                [_plot(one.fit_position, one.fit_volts) for one in waveforms], colors=colors,
                labels=[f'film {one.film + 1}, fit' for one in waveforms], show_labels=False,
                radii=rr.Radius.ui_points(1.0)))
        self._recorder.shape(f'{base}/result', stamp_ns, rr.TextDocument(
            _summary(friction, fitted=bool(waveforms)), media_type='text/markdown'))


def draw_axes(recorder: Recorder, base: str, robot: RobotParams) -> None:
    """Draw the axes of a crossing and the edges of the contact patch."""
    top, bottom = (_plot(np.zeros(1), edge)[0, 1] for edge in (VOLTS[-1:], VOLTS[:1]))
    edge = 0.5 * MM_PER_M * robot.tire.contact_length
    volts = _plot(np.zeros(len(VOLTS)), VOLTS)[:, 1]
    lines = [*([(-REACH, y), (REACH, y)] for y in volts),
             *([(x, top), (x, bottom)] for x in PLACES)]
    recorder.static(f'{base}/axes', rr.LineStrips2D(
        lines, colors=(*AXIS, 90), radii=rr.Radius.ui_points(0.5)))
    recorder.static(f'{base}/patch', rr.LineStrips2D(
        [[(x, top), (x, bottom)] for x in (-edge, edge)], colors=AXIS,
        radii=rr.Radius.ui_points(1.5), labels='edge of the patch', show_labels=False))
    ticks = [*((-REACH, y) for y in volts[1:]), *((x, bottom) for x in PLACES)]
    labels = [*(f'{value:+.1f} V' for value in VOLTS[1:]), *(f'{x:g} mm' for x in PLACES)]
    recorder.static(f'{base}/ticks', rr.Points2D(
        ticks, labels=labels, show_labels=True, colors=AXIS, radii=rr.Radius.ui_points(1.0)))


def _plot(position: Array, volts: Array) -> Array:
    """Return points on the screen of positions [m] and voltages [V]."""
    return np.stack([MM_PER_M * position, -MM_PER_V * volts], axis=-1)


def _summary(friction: Friction, *, fitted: bool) -> str:
    """Return the result of a crossing as a table."""
    if not fitted:
        return f'**{friction.wheel}**: no waveform was fitted to the latest crossing; ' \
               'the one before is shown'
    rows = (('slip', friction.slip, '-'), ('slip, films alone', friction.film_slip, '-'),
            ('adhesion ratio', friction.adhesion_ratio, '-'),
            ('friction, this crossing', friction.friction_coefficient_single, '-'),
            ('friction, fused', friction.friction_coefficient, '-'),
            ('normal load', friction.normal_load, 'N'),
            ('stiffness C_x', friction.stiffness, 'N'),
            ('traction force', friction.traction_force, 'N'))
    return '\n'.join((f'| {friction.wheel}, crossing | | |', '| --- | --- | --- |',
                      *(f'| {name} | {_text(value)} | {unit} |' for name, value, unit in rows)))


def _text(value: Uncertain) -> str:
    return f'{value.value:.3g} ± {value.sigma:.2g}' if finite(value) else 'unknown'
