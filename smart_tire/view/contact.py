# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contact of the wheels: film voltages, latest patch crossings, friction circles and forces."""

from __future__ import annotations

from collections import deque
import math
from typing import Any

import numpy as np
import rerun as rr

from smart_tire.analysis.crossing import crossing_waveform, CrossingWaveform
from smart_tire.arrays import Array
from smart_tire.models.tire.brush_tire import brush_force, slip_vector
from smart_tire.models.vehicle.skid_steer import normal_loads, wheel_velocities
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import (
    Friction, GroundState, LEFT, NS_PER_S, Odometry, RIGHT, Sample, TireSample, WHEELS,
    WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain
from smart_tire.view.writer import AXIS, FILM_COLORS, SeriesBuffer, ViewWriter, WHEEL_COLORS

BLOCK = 20            # samples that are thinned together
RESTING_RANGE = 0.03  # V, range of a block in which nothing but noise is
MAX_PERIODS = 4       # of samples; a longer interval is a gap
KEPT_NS = 4 * NS_PER_S  # of film and wheel samples, until the crossing in them is estimated
MM_PER_M, MM_PER_V = 1e3, 30.0         # scales of a crossing
VOLTS = np.arange(-1.5, 1.6, 0.5)      # V, ticks
PLACES = np.arange(-60.0, 61.0, 30.0)  # mm, ticks
PERIOD_NS = 64_000_000       # between two evaluations of the forces
MAX_AGE_NS = NS_PER_S // 10  # of the odometry
CORNERS = np.array([[-50.0, -35.0], [50.0, -35.0], [-50.0, 30.0], [50.0, 30.0]])  # N, on screen
LABEL_GAP = 6.0  # N, below a circle
CIRCLE = np.linspace(0.0, math.tau, 49)
SHOWN = (('slip', 'slip', '-'), ('slip, films alone', 'film_slip', '-'),
         ('adhesion ratio', 'adhesion_ratio', '-'),
         ('friction, this crossing', 'friction_coefficient_single', '-'),
         ('friction, fused', 'friction_coefficient', '-'), ('normal load', 'normal_load', 'N'),
         ('stiffness C_x', 'stiffness', 'N'), ('traction force', 'traction_force', 'N'))


class FilmLayer:
    """
    Raw voltages of the films.

    Of blocks without any signal only the lowest and the highest sample are kept; all others are
    complete. A gap between samples interrupts the line.
    """

    def __init__(self, writer: ViewWriter, period_ns: int) -> None:
        self._writer, self._max_gap_ns = writer, MAX_PERIODS * period_ns
        self._blocks: dict[tuple[str, int], list[tuple[int, float]]] = {}

    def add_films(self, sample: TireSample) -> None:
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
        buffer = self._buffer(wheel, film)
        for stamp_ns, volts in thinned(block):
            buffer.add(stamp_ns, volts)
        if interrupted:
            buffer.add(block[-1][0] + 1, math.nan)
        block.clear()

    def _buffer(self, wheel: str, film: int) -> SeriesBuffer:
        return self._writer.line(
            f'films/{wheel}/film_{film + 1}', f'film {film + 1} [V]',
            FILM_COLORS[film % len(FILM_COLORS)], width=1.0)


def thinned(block: list[tuple[int, float]]) -> list[tuple[int, float]]:
    """Return all samples of a block with a signal, otherwise the lowest and the highest."""
    if not block:
        return []
    low, high = (choose(block, key=lambda sample: sample[1]) for choose in (min, max))
    return block if high[1] - low[1] > RESTING_RANGE else sorted({low, high})


class CrossingLayer:
    """The latest crossing of each wheel: its voltages, and the model for the estimates."""

    def __init__(self, writer: ViewWriter, robot: RobotParams) -> None:
        self._writer, self._robot = writer, robot
        self._films: dict[str, deque[TireSample]] = {}
        self._wheels: deque[WheelSample] = deque()
        for wheel in robot.film.wheels:
            draw_axes(writer, f'contact/{wheel}', robot)

    def add_films(self, sample: TireSample) -> None:
        """Add the voltages of one conversion."""
        _keep(self._films.setdefault(sample.wheel, deque()), sample)

    def add_wheels(self, sample: WheelSample) -> None:
        """Add measured speeds of the wheels."""
        _keep(self._wheels, sample)

    def add_friction(self, friction: Friction) -> None:
        """Show a crossing; without its samples the waveform of the one before remains."""
        base, stamp_ns = f'contact/{friction.wheel}', friction.stamp_ns
        waveform = self._waveform(friction)
        if waveform is not None:
            self._show(base, stamp_ns, waveform)
        self._writer.shape(f'{base}/result', stamp_ns, rr.TextDocument(
            _summary(friction, shown=waveform is not None), media_type='text/markdown'))

    def _waveform(self, friction: Friction) -> CrossingWaveform | None:
        samples = [one for one in self._films.get(friction.wheel, ())
                   if len(one.volts) == self._robot.film.count]
        if not samples or not self._wheels:
            return None
        nearest = min(self._wheels, key=lambda one: abs(one.stamp_ns - friction.stamp_ns))
        return crossing_waveform(
            friction, np.array([one.stamp_ns for one in samples], np.int64),
            np.array([one.volts for one in samples]),
            nearest.velocity[WHEELS.index(friction.wheel)], self._robot)

    def _show(self, base: str, stamp_ns: int, waveform: CrossingWaveform) -> None:
        films = waveform.films
        colors = [FILM_COLORS[one.film % len(FILM_COLORS)] for one in films]
        counts = [len(one.position) for one in films]
        # one entity, so that samples and model are always those of the same crossing
        self._writer.shape(f'{base}/waveforms', stamp_ns, rr.Points2D(
            np.concatenate([_plot(one.position, one.volts - one.rest) for one in films]),
            colors=np.repeat(np.array(colors, np.uint8), counts, axis=0),
            radii=rr.Radius.ui_points(2.5)), rr.LineStrips2D(
            [_plot(one.model_position, one.model_volts - one.rest) for one in films],
            colors=colors, labels=[f'film {one.film + 1}, model' for one in films],
            show_labels=False, radii=rr.Radius.ui_points(1.0)))


def _keep(samples: deque[Any], sample: Sample) -> None:
    """Append ``sample`` and drop those that are too old."""
    samples.append(sample)
    while samples[0].stamp_ns < sample.stamp_ns - KEPT_NS:
        samples.popleft()


def draw_axes(writer: ViewWriter, base: str, robot: RobotParams) -> None:
    """Draw the axes of a crossing and the edges of the contact patch."""
    heights, end = -MM_PER_V * VOLTS, PLACES[-1]
    top, bottom = heights[-1], heights[0]
    edge = 0.5 * MM_PER_M * robot.tire.contact_length
    lines = [*([(-end, y), (end, y)] for y in heights),
             *([(x, top), (x, bottom)] for x in PLACES)]
    writer.static(f'{base}/axes', rr.LineStrips2D(
        lines, colors=(*AXIS, 90), radii=rr.Radius.ui_points(0.5)))
    writer.static(f'{base}/patch', rr.LineStrips2D(
        [[(x, top), (x, bottom)] for x in (-edge, edge)], colors=AXIS,
        radii=rr.Radius.ui_points(1.5), labels='edge of the patch', show_labels=False))
    writer.static(f'{base}/ticks', rr.Points2D(
        [*((-end, y) for y in heights[1:]), *((x, bottom) for x in PLACES)],
        labels=[*(f'{value:+.1f} V' for value in VOLTS[1:]), *(f'{x:g} mm' for x in PLACES)],
        show_labels=True, colors=AXIS, radii=rr.Radius.ui_points(1.0)))


def _plot(position: Array, volts: Array) -> Array:
    """Return points on the screen of positions [m] and voltages [V]."""
    return np.stack([MM_PER_M * position, -MM_PER_V * volts], axis=-1)


def _summary(friction: Friction, *, shown: bool) -> str:
    """Return the result of a crossing as a table."""
    rows = [f'| {label} | {_text(friction.quantity(name))} | {unit} |'
            for label, name, unit in SHOWN]
    note = [] if shown else ['', 'It has no samples; those of the one before remain.']
    return '\n'.join((f'| {friction.wheel}, crossing | | |', '| --- | --- | --- |', *rows, *note))


def _text(value: Uncertain) -> str:
    known = math.isfinite(value.value) and math.isfinite(value.sigma)
    return f'{value.value:.3g} ± {value.sigma:.2g}' if known else 'unknown'


class ForceLayer:
    """
    Force and friction circle of each wheel, as seen from above, forward is up.

    Slip, C_x and mu are the estimated ones, loads those of level ground in steady motion. A wheel
    without films gets mu of an instrumented wheel, preferably of its side.
    """

    def __init__(self, writer: ViewWriter, robot: RobotParams) -> None:
        self._writer, self._robot = writer, robot
        self._odometry: Odometry | None = None
        self._friction: dict[str, float] = {}  # wheel -> mu
        self._stiffness = robot.tire.longitudinal_stiffness
        self._evaluated_ns: int | None = None
        self._used = [writer.line(
            f'friction_used/{wheel}', f'{wheel}, |F| / (mu F_z) [-]', color)
            for wheel, color in WHEEL_COLORS.items()]
        self._traction = [writer.line(f'traction/{wheel}/model', f'{wheel}, F_x [N]', color)
                          for wheel, color in WHEEL_COLORS.items()]

    def add_odometry(self, sample: Odometry) -> None:
        """Add the motion of the body."""
        self._odometry = sample

    def add_friction(self, sample: Friction) -> None:
        """Add the friction coefficient of a wheel."""
        if math.isfinite(sample.friction_coefficient.value):
            self._friction[sample.wheel] = sample.friction_coefficient.value

    def add_ground(self, sample: GroundState) -> None:
        """Add the stiffness of the present ground."""
        self._stiffness = sample.stiffness.value

    def add_slip(self, sample: WheelSlip) -> None:
        """Add slips; evaluate the forces if it is time."""
        odometry, last_ns = self._odometry, self._evaluated_ns
        if (odometry is None or not self._friction
                or abs(sample.stamp_ns - odometry.stamp_ns) > MAX_AGE_NS
                or last_ns is not None and 0 <= sample.stamp_ns - last_ns < PERIOD_NS):
            return
        self._evaluated_ns = sample.stamp_ns
        self._show(sample.stamp_ns, *self.evaluate(sample, odometry))

    def evaluate(self, slip: WheelSlip, odometry: Odometry) -> tuple[Array, Array]:
        """Return the forces (4, 2) [N], forward and to the left, and mu F_z (4,) [N]."""
        robot, (v_x, v_y, _), rate = self._robot, odometry.linear, odometry.angular[2]
        wheel_x, wheel_y = wheel_velocities(v_x, v_y, rate, robot.wheelbase, robot.track_width)
        loads = normal_loads(robot, -rate * v_y, rate * v_x)
        friction = np.array([self._friction[self.source(wheel)] for wheel in WHEELS])
        s_x, s_y = slip_vector(wheel_x + np.array(slip.slip_velocity), wheel_x, wheel_y,
                               floor=robot.slip.standstill_speed)
        force = brush_force(s_x, s_y, friction, loads, self._stiffness)
        return np.stack(force, axis=-1), friction * loads

    def source(self, wheel: str) -> str:
        """Return the wheel whose mu is used for ``wheel``; there is at least one with mu."""
        side = LEFT if WHEELS.index(wheel) in LEFT else RIGHT
        candidates = [wheel, *(WHEELS[i] for i in side), *WHEELS]
        return next(name for name in candidates if name in self._friction)

    def _show(self, stamp_ns: int, force: Array, limit: Array) -> None:
        share = np.hypot(*force.T) / np.maximum(limit, 1e-9)
        for used, traction, part, value in zip(self._used, self._traction, share, force[:, 0]):
            used.add(stamp_ns, float(part))
            traction.add(stamp_ns, float(value))
        colors = list(WHEEL_COLORS.values())
        circle = np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], axis=-1)
        self._writer.shape('forces/circles', stamp_ns, rr.LineStrips2D(
            CORNERS[:, np.newaxis] + limit[:, np.newaxis, np.newaxis] * circle, colors=colors,
            radii=rr.Radius.ui_points(1.0)), rr.Points2D(
            CORNERS + np.stack([np.zeros(len(limit)), limit + LABEL_GAP], axis=-1), colors=colors,
            labels=[self._label(wheel, float(value)) for wheel, value in zip(WHEELS, limit)],
            show_labels=True, radii=rr.Radius.ui_points(0.0)))
        # forward is up, left is left: both against the axes of the screen
        self._writer.shape('forces/arrows', stamp_ns, rr.Arrows2D(
            vectors=-force[:, ::-1], origins=CORNERS, colors=colors,
            labels=[f'{math.hypot(*one):.1f} N' for one in force.tolist()], show_labels=False,
            radii=rr.Radius.ui_points(2.5)))

    def _label(self, wheel: str, limit: float) -> str:
        source = self.source(wheel)
        note = '' if source == wheel else f'\nwith mu of {source}'
        return f'{wheel}: mu F_z {limit:.0f} N{note}'
