# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""All methods of the benchmark on one run."""

from dataclasses import replace
import math

from benchmarks.events import has_efforts
from benchmarks.motion import Estimate
from benchmarks.slip import methods
from benchmarks.slip.methods import compare_methods, LIVE, METHODS
import numpy as np
from smart_tire.analysis.dead_reckoning import as_inputs, gyro_odometry
from smart_tire.parameters import RobotParams, SlipEstimatorParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import WheelSample
from support.driving import drive, ramp

ROBOT = RobotParams()


def moving():
    """Return a run without slip."""
    speeds = ramp([(0, 0, 0), (2, 0, 0), (3, .5, .5), (9, .6, .4), (12, 0, 0)])
    return drive(speeds, np.zeros_like(speeds), icr=0.0, robot=ROBOT, noise=1.0, wheel_rate=20.0)


def test_every_method_gives_estimates():
    run = moving()
    estimates = compare_methods(run.samples, SlipEstimatorParams(robot=ROBOT))
    assert list(estimates) == [name for name in METHODS if 'torque' not in name]
    assert all(len(estimate.poses.stamp_ns) > 200 for estimate in estimates.values())
    assert 0.0 < estimates[LIVE].step_us < math.inf
    assert math.isfinite(estimates[LIVE].nis)


def test_torques_are_used_by_their_own_methods_only(monkeypatch):
    run = moving()
    samples = [replace(sample, effort=(0.1,) * 4) if isinstance(sample, WheelSample) else sample
               for sample in run.samples]
    efforts = {}

    def candidate(name):
        def estimate(inputs, params):
            efforts[name] = efforts.get(name, []) + [has_efforts(inputs)]
            return Estimate(*gyro_odometry(as_inputs(SampleArrays(inputs), params.robot)))
        return estimate
    for name in ('live_estimate', 'smoothed_estimate'):
        monkeypatch.setattr(methods, name, candidate(name))
    estimates = compare_methods(samples, SlipEstimatorParams(robot=ROBOT))
    assert list(estimates) == list(METHODS)
    assert efforts == {'live_estimate': [False, True], 'smoothed_estimate': [False, True]}
