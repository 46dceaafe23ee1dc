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

"""Figure of identified motors: measured torque over the force balance, duty over speed."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.calibration.robot.motor import FEED_FORWARD, MotorFit


def write_motor(path: Path, found: MotorFit) -> bool:
    """Draw the available fits to ``path``; return False without any."""
    names = ([] if found.ground is None else ['torque']) + ([] if found.duty is None else ['duty'])
    if not names:
        return False
    figure, axes = drawing.new_figure([names], width=5.5 * len(names), height=4.6)
    if 'torque' in names:
        draw_torque(axes['torque'], found)
    if 'duty' in names:
        draw_duty(axes['duty'], found)
    for ax in axes.values():
        drawing.legend_on_top(ax)
    drawing.add_caption(
        figure, 'Torque: with the right torque constant, the measured torque equals the one that '
        'force and inertia require (dashed). Values are given with their standard errors.')
    figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
    return True


def draw_torque(ax: Axes, found: MotorFit) -> None:
    """Draw the measured torque of all wheels over the one that force and inertia require."""
    ground = found.ground
    if ground is None:
        return
    ax.plot(ground.balance, ground.torque, '.', color=drawing.SKY, markersize=4,
            label='measured, without friction')
    ends = np.array([ground.balance.min(), ground.balance.max()])
    ax.plot(ends, ground.kappa.value * ends, color=drawing.VERMILLION, linewidth=1.2,
            label=f'slope {ground.kappa.value:.3f}')
    ax.plot(ends, ends, color=drawing.INK, linewidth=1.0, linestyle='--', label='equal')
    ax.set(xlabel='r m f + J dw/dt of all wheels [N m]', ylabel='measured motor torque [N m]')


def draw_duty(ax: Axes, found: MotorFit) -> None:
    """Draw the mean duty over the mean speed of the wheels, and the feed-forward."""
    if found.duty is None:
        return
    speed, duty = found.duty
    ax.plot(speed, duty, '.', color=drawing.SKY, markersize=4, label='in motion')
    gain = found.get(FEED_FORWARD)
    if gain is not None:
        ends = np.array([speed.min(), speed.max()])
        ax.plot(ends, gain.value * ends, color=drawing.VERMILLION, linewidth=1.2,
                label=f'feed-forward {gain.value:.4f} ± {gain.sigma:.1g} s/rad')
    ax.set(xlabel='wheel speed [rad/s]', ylabel='duty [-]')
