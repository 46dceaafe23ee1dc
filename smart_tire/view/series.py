# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The plots of the viewer: which values of which topic are shown where, and by which name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
import math
from operator import attrgetter
from typing import Any

from smart_tire.analysis.figure import MAX_SLIP_SIGMA, SIGMAS
from smart_tire.samples import Friction, Odometry, Sample, WHEELS, WheelSlip
from smart_tire.uncertain import Uncertain
from smart_tire.view.writer import (
    CAMERA, Color, COMMAND, ESTIMATE, SeriesBuffer, TRUTH, ViewWriter, WHEEL_COLORS, XYZ_COLORS)

UNKNOWN_TWIST = -1.0  # first covariance of a twist that is not given (ROS)


@dataclass(frozen=True)
class Plot:
    """
    Values of some topics that are shown; None is not shown.

    With ``{}`` in its path there is a series for each wheel: of the wheel that a sample names,
    otherwise ``values`` returns one value per wheel.
    """

    topics: Sequence[str]
    path: str  # of the entity
    name: str  # with its unit
    values: Callable[[Any], Any]
    color: Color | None = None  # None: that of the wheel
    draw: Callable[..., SeriesBuffer] = ViewWriter.line

    def buffers(self, writer: ViewWriter) -> list[SeriesBuffer]:
        """Return the buffer of each series."""
        wheels = WHEELS if '{}' in self.path else ('',)
        return [self.draw(writer, self.path.format(wheel), self.name.format(wheel),
                          self.color or WHEEL_COLORS[wheel]) for wheel in wheels]

    def add_sample(self, buffers: Sequence[SeriesBuffer], sample: Sample) -> None:
        """Add the values of a sample to its buffers."""
        found = self.values(sample)
        if found is None:
            return
        if len(buffers) == 1:
            buffers[0].add_value(sample.stamp_ns, found)
        elif (wheel := getattr(sample, 'wheel', None)) is not None:
            buffers[WHEELS.index(wheel)].add_value(sample.stamp_ns, found)
        else:
            for buffer, value in zip(buffers, found):
                buffer.add_value(sample.stamp_ns, value)


class SeriesLayer:
    """All plots."""

    def __init__(self, writer: ViewWriter) -> None:
        self._plots: dict[str, list[tuple[Plot, list[SeriesBuffer]]]] = {}
        for plot in PLOTS:
            buffers = plot.buffers(writer)
            for topic in plot.topics:
                self._plots.setdefault(topic, []).append((plot, buffers))

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the topics that are plotted."""
        return tuple(self._plots)

    def add_sample(self, topic: str, sample: Sample) -> None:
        """Add the values of a sample."""
        for plot, buffers in self._plots.get(topic, ()):
            plot.add_sample(buffers, sample)


def _slips(sample: WheelSlip) -> list[Uncertain]:
    """Return the slips; NaN where they are not observable, such as around a standstill."""
    return [Uncertain(ratio if sigma <= MAX_SLIP_SIGMA else math.nan, sigma)
            for ratio, sigma in zip(sample.ratio, sample.sigma)]


def _twist(field: str, axis: int) -> Callable[[Odometry], Uncertain | None]:
    """Return the function that returns a component of the twist."""
    index = 7 * (axis if field == 'linear' else axis + 3)  # in the row-major 6x6 covariance
    return lambda sample: None if sample.twist_covariance[0] == UNKNOWN_TWIST else Uncertain(
        getattr(sample, field)[axis], math.sqrt(max(sample.twist_covariance[index], 0.0)))


def _component(field: str, axis: int) -> Callable[[Any], float]:
    return lambda sample: float(getattr(sample, field)[axis])


def _bound(sign: float) -> Callable[[Friction], float]:
    """Return the function that returns the end of the bar of a single crossing."""
    def bound(sample: Friction) -> float:
        single = sample.friction_coefficient_single
        return single.value + sign * SIGMAS * single.sigma
    return bound


LINE, ESTIMATED, POINTS = ViewWriter.line, ViewWriter.estimate, ViewWriter.points
STEPS, THIN, SMALL = (partial(LINE, steps=True), partial(LINE, width=1.0),
                      partial(POINTS, size=2.0))

PLOTS = (
    Plot(['wheel_slip'], 'slip/{}/estimate', '{} [-]', _slips, draw=ESTIMATED),
    Plot(['film_deflection'], 'film/deflection', 'deflection of the film [m]',
         attrgetter('deflection'), ESTIMATE, ESTIMATED),
    Plot(['ground_truth/film_deflection'], 'film/truth', 'deflection, truth [m]',
         attrgetter('deflection.value'), TRUTH, THIN),
    Plot(['film_charge'], 'film_signals/charge', 'charge of the film [C]', attrgetter('charge'),
         COMMAND, THIN),
    Plot(['film_temperature'], 'film_signals/temperature', 'temperature of the film [°C]',
         attrgetter('value'), CAMERA, THIN),
    Plot(['ground_truth/wheel_slip'], 'slip/{}/truth', '{}, truth [-]', attrgetter('ratio'),
         TRUTH, THIN),
    Plot(['overhead/wheel_slip'], 'slip/{}/camera', '{}, camera [-]', _slips, CAMERA, ESTIMATED),
    *(Plot([topic], f'wheels/{kind}/{{}}', f'{{}}, {name}', attrgetter(field), draw=draw)
      for topic, kind, name, field, draw in (
          ('wheel_states', 'speed', 'measured [rad/s]', 'velocity', LINE),
          ('wheel_states', 'torque', 'torque [N m]', 'effort', LINE),
          ('wheel_commands', 'set_point', 'set point [rad/s]', 'velocity', STEPS),
          ('motor_commands', 'duty', 'duty [-]', 'duty', STEPS))),
    Plot(['tire_battery'], 'battery/{}', '{} [V]', attrgetter('volts')),
    *(Plot(topics, f'body/{name}/{kind}', f'{kind} [{unit}]', values, color, draw)
      for name, unit, twist, command in (
          ('velocity', 'm/s', _twist('linear', 0), attrgetter('v_x')),
          ('yaw_rate', 'rad/s', _twist('angular', 2), attrgetter('yaw_rate')))
      for topics, kind, values, color, draw in (
          (['odom'], 'estimate', twist, ESTIMATE, ESTIMATED),
          (['ground_truth/odom'], 'truth', twist, TRUTH, LINE),
          (['overhead/odom'], 'camera', twist, CAMERA, ESTIMATED),
          (['cmd_vel'], 'command', command, COMMAND, STEPS))),
    *(Plot(['icr'], f'body/icr/{axis}', f'{axis} [m]', attrgetter(axis), color)
      for axis, color in zip('xy', XYZ_COLORS)),
    *(Plot(['path_progress'], f'progress/{field}', name, attrgetter(field), color, draw)
      for field, name, color, draw in (
          ('cross_track_error', 'cross-track error [m]', COMMAND, LINE),
          ('remaining_distance', 'remaining distance [m]', TRUTH, LINE),
          ('state', 'state', COMMAND, STEPS))),
    *(Plot(['imu/data'], f'imu/{field}/{axis}', f'{axis} [{unit}]', _component(field, i), color,
           THIN)
      for field, unit in (('acceleration', 'm/s²'), ('rate', 'rad/s'))
      for i, (axis, color) in enumerate(zip('xyz', XYZ_COLORS))),
    Plot(['tire_friction'], 'friction/{}/fused', '{}, fused [-]',
         attrgetter('friction_coefficient'), draw=ESTIMATED),
    Plot(['tire_friction'], 'friction/{}/single', '{}, single crossing [-]',
         attrgetter('friction_coefficient_single'), draw=POINTS),
    *(Plot(['tire_friction'], f'friction/{{}}/single_bound/{marker}',
           f'{{}}, single {sign * SIGMAS:+g} σ [-]', _bound(sign),
           draw=partial(SMALL, marker=marker, dim=True))
      for sign, marker in ((-1.0, 'down'), (1.0, 'up'))),
    Plot(['ground_truth/tire_friction'], 'friction/{}/truth', '{}, truth [-]',
         attrgetter('friction_coefficient'), TRUTH, STEPS),
    Plot(['tire_friction'], 'traction/{}/crossing', '{}, F_x of a crossing [N]',
         attrgetter('traction_force'), draw=POINTS),
    Plot(['tire_friction'], 'stiffness/{}', '{}, C_x used [N]', attrgetter('stiffness'),
         draw=SMALL),
    Plot(['ground_state'], 'stiffness/ground', 'C_x of the ground [N]', attrgetter('stiffness'),
         ESTIMATE, ESTIMATED),
    Plot(['ground_state'], 'rolling_resistance/ground', 'rolling resistance over load [-]',
         attrgetter('rolling_resistance'), ESTIMATE, ESTIMATED))
