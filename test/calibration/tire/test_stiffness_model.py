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

"""Residuals of the straight-line motion, and their derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.calibration.tire.stiffness_model import Common, Noise, SegmentModel
from smart_tire.calibration.tire.straight_segments import straight_segments
from smart_tire.parameters import build, RobotParams
from support.driving import STEP
from support.straight import CONCRETE, motion, SAND, straight_run

ROBOT = RobotParams()
FINE = build(RobotParams, {'encoder.counts_per_revolution': 1_000_000})
NOISE = Noise(0.001, 0.1)


def common(ground, latency_error=0.0):
    """Return the common parameters of a ground."""
    return np.array([math.log(ground.stiffness), ground.drag, math.log(ground.friction),
                     latency_error, 0.0, 0.0])


def model_of(ground, **options):
    run = straight_run(ground, 0, noise=0.0, robot=FINE, wheel_rate=20.0, **options)
    segment, = straight_segments(run, FINE)
    return SegmentModel(segment, FINE)


def true_motion(model, ground):
    """Return the true local unknowns."""
    rolling, over_ground = motion(ground)
    rows = (model.segment.time / STEP).astype(int)
    local = model.start()
    v, u = model.speeds(local)
    v[:], u[:] = over_ground[rows], rolling[rows]
    return local


def rms(model, parameters, local, group):
    block, = [block for block in model.blocks(parameters, local, NOISE) if block.group == group]
    counted = slice(None) if block.counted is None else block.counted
    return float(np.sqrt(np.mean(block.residual[counted] ** 2)))


@pytest.mark.parametrize('ground', [CONCRETE, SAND])
def test_the_true_motion_has_small_residuals(ground):
    model = model_of(ground)
    local = true_motion(model, ground)
    assert rms(model, common(ground), local, 'force') < 1.0  # 0.1 m/s2
    assert rms(model, common(ground), local, 'accelerometer') < 1.5


def test_a_wrong_stiffness_violates_the_force_balance():
    model = model_of(CONCRETE)
    local = true_motion(model, CONCRETE)
    wrong = common(type(CONCRETE)(30.0, CONCRETE.friction, CONCRETE.drag))
    assert rms(model, wrong, local, 'force') > 3.0 * rms(model, common(CONCRETE), local, 'force')


def test_slip_and_force_are_positive_when_accelerating_and_negative_when_braking():
    model = model_of(CONCRETE)
    slip, force = model.motion(common(CONCRETE), true_motion(model, CONCRETE))
    middle = 0.5 * (model.segment.time[1:] + model.segment.time[:-1])
    up, down = ((sign * model.segment.force > 0.3) & (middle > 2.0) for sign in (1.0, -1.0))
    assert (slip[up] > 0.0).all() and (force[up] > 0.0).all()
    assert (slip[down] < 0.0).all() and (force[down] < 0.0).all()


@pytest.mark.parametrize('ground', [CONCRETE, SAND])
def test_derivatives_agree_with_finite_differences(ground):
    model, rng = model_of(ground), np.random.default_rng(1)
    parameters = common(ground, 0.002) + np.array([0.0, 0.0, 0.0, 0.0, 0.02, 0.05])
    local = true_motion(model, ground) + 1e-4 * rng.standard_normal(model.size)
    step, directions = 1e-6, (rng.standard_normal(len(Common)), rng.standard_normal(model.size))
    for common_step, local_step in ((directions[0], 0.0 * directions[1]),
                                    (0.0 * directions[0], directions[1])):
        blocks = model.blocks(parameters, local, NOISE)
        upper, lower = (model.blocks(parameters + sign * step * common_step,
                                     local + sign * step * local_step, NOISE)
                        for sign in (1.0, -1.0))
        for block, above, below in zip(blocks, upper, lower):
            expected = block.by_common @ common_step + block.by_local @ local_step
            numeric = (above.residual - below.residual) / (2.0 * step)
            # edges of the brush curve are not smooth, interpolated stamps not exact
            assert np.median(np.abs(numeric - expected)) <= 1e-4 * max(np.abs(expected).max(), 1.0)


def test_an_unresolved_change_of_the_wheel_speed_has_no_weight():
    """A step of the wheel speed between two samples: its time is unknown."""
    model = model_of(CONCRETE, pace=lambda time: 0.5 if time < 8.0 else 1.0)
    block, = [block for block in model.blocks(common(CONCRETE), model.start(), NOISE)
              if block.group == 'force']
    middle = 0.5 * (model.segment.time[1:] + model.segment.time[:-1])
    assert not block.counted[np.abs(middle - 8.0) < 0.03].any()
    assert block.counted[(middle > 9.0) & (middle < 15.0)].all()
