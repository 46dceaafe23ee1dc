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

"""Friction coefficient and stiffness of the ground."""

from __future__ import annotations

from smart_tire.samples import Friction, GroundState
from smart_tire.view.recorder import finite, Marker, Recorder
from smart_tire.view.style import dimmed, ESTIMATE, SIGMAS, TRUTH, WARNING, WHEEL_COLORS

BOUND_MARKERS: tuple[tuple[float, Marker], ...] = ((-SIGMAS, 'down'), (SIGMAS, 'up'))


class FrictionLayer:
    """Friction of the instrumented wheels: fused, of single crossings, and true; C_x."""

    def __init__(self, recorder: Recorder) -> None:
        colors = WHEEL_COLORS.items()
        self._fused = {wheel: recorder.estimate(
            f'friction/{wheel}/fused', f'{wheel}, fused [-]', color) for wheel, color in colors}
        self._single = {wheel: recorder.points(
            f'friction/{wheel}/single', f'{wheel}, single crossing [-]', color)
            for wheel, color in colors}
        self._single_bounds = {(wheel, sign): recorder.points(
            f'friction/{wheel}/single_bound/{name}', f'{wheel}, single {sign:+g} σ [-]',
            dimmed(color), marker=name, size=2.0)
            for wheel, color in colors for sign, name in BOUND_MARKERS}
        self._truths = {wheel: recorder.line(
            f'friction/{wheel}/truth', f'{wheel}, truth [-]', TRUTH, steps=True)
            for wheel, color in colors}
        self._changes = {wheel: recorder.points(
            f'friction/{wheel}/ground_change', f'{wheel}, change of the ground', WARNING,
            marker='diamond', size=8.0) for wheel, color in colors}
        self._forces = {wheel: recorder.points(
            f'traction/{wheel}/crossing', f'{wheel}, F_x of a crossing [N]', color)
            for wheel, color in colors}
        self._ground = recorder.estimate('stiffness/ground', 'C_x of the ground [N]', ESTIMATE)
        self._used = {wheel: recorder.points(
            f'stiffness/{wheel}', f'{wheel}, C_x used [N]', color, size=2.0)
            for wheel, color in colors}
        self._rolling = recorder.estimate(
            'rolling_resistance/ground', 'rolling resistance over load [-]', ESTIMATE)

    def add(self, sample: Friction) -> None:
        """Add the estimates of a crossing."""
        stamp_ns, wheel = sample.stamp_ns, sample.wheel
        self._fused[wheel].add_estimate(stamp_ns, *sample.friction_coefficient)
        if finite(single := sample.friction_coefficient_single):
            self._single[wheel].add(stamp_ns, single.value)
            for sign, _ in BOUND_MARKERS:
                self._single_bounds[wheel, sign].add(
                    stamp_ns, single.value + sign * single.sigma)
        if finite(sample.traction_force):
            self._forces[wheel].add(stamp_ns, sample.traction_force.value)
        if finite(sample.stiffness):
            self._used[wheel].add(stamp_ns, sample.stiffness.value)

    def add_truth(self, sample: Friction) -> None:
        """Add the true friction coefficient."""
        self._truths[sample.wheel].add(sample.stamp_ns, sample.friction_coefficient.value)

    def add_ground(self, sample: GroundState) -> None:
        """Add stiffness and rolling resistance of the ground."""
        self._ground.add_estimate(sample.stamp_ns, *sample.stiffness)
        self._rolling.add_estimate(sample.stamp_ns, *sample.rolling_resistance)

    def add_change(self, sample: Friction) -> None:
        """Mark a change of the ground that the crossing of ``sample`` revealed."""
        self._changes[sample.wheel].add(sample.stamp_ns, sample.friction_coefficient.value)
