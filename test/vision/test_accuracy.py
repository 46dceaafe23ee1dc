# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Accuracy of the overhead camera in scenes of the simulated robot, full images; minutes each."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from smart_tire.bags import Bag
from smart_tire.cli.main import main
from smart_tire.parameters import build, SimulatorParams
from smart_tire.parameters.overhead import ImageParams, OverheadParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import NS_PER_S
from smart_tire.simulation.offline import simulate
from smart_tire.vision.renderer import Renderer
from support.overhead import RADIUS, START_NS, write_bag

pytestmark = pytest.mark.long

DURATION, RATE = 12.0, 15.0  # s, Hz
INPUTS = 'imu/data', 'wheel_states'


def drive(seed):
    """Return the events of a random drive of the simulated robot."""
    rng, time, phases = np.random.default_rng(seed), 1.0, [(0.0, 0.0, 0.0)]
    while time < DURATION - 1.5:
        speed = rng.choice([-1, 1]) * rng.uniform(30.0, 60.0)  # rpm
        left, right = [(1.0, 1.0), (1.0, 0.6), (0.6, 1.0), (-0.5, 0.5)][rng.integers(4)]
        phases.append((time, left * speed, right * speed))
        time += rng.uniform(1.5, 3.0)
    params = build(SimulatorParams, {'film.wheels': [], 'seed': int(seed)})
    return simulate(params, [*phases, (DURATION - 1.0, 0.0, 0.0)], DURATION, start_ns=START_NS)


@pytest.mark.parametrize('seed', range(401, 411))
def test_pose_velocity_and_slip_are_as_accurate_as_stated(seed, tmp_path):
    events, rng = drive(seed), np.random.default_rng([seed, 1])
    truth = SampleArrays(one for _, name, one in events if name.startswith('ground_truth/'))
    poses, slips = truth.poses(), truth.slips()
    known = (poses.stamp_ns - START_NS) / NS_PER_S
    middle = 0.5 * (poses.pose.min(0) + poses.pose.max(0)) * (1.0, 1.0, 0.0)

    def at(times, values):
        return np.column_stack([np.interp(times, known, column) for column in values.T])

    camera = ImageParams(
        rotation=(math.pi + rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), rng.uniform(-3, 3)),
        exposure=rng.uniform(0.002, 0.01), noise=rng.uniform(1.0, 3.0),
        brightness=rng.uniform(0.5, 1.0), lens_blur=rng.uniform(0.4, 0.9),
        distortion=(rng.uniform(-0.2, 0.0), rng.uniform(0.0, 0.05), 0.0005, -0.0005, 0.0))
    renderer = Renderer(camera, OverheadParams(), RADIUS, seed)
    bag = write_bag(tmp_path / 'bag', renderer, lambda times: at(times, poses.pose) - middle,
                    np.arange(0.2, DURATION - 0.3, 1.0 / RATE),
                    [(name, one) for _, name, one in events if name in INPUTS])
    params = tmp_path / 'overhead.yaml'
    params.write_text('/**:\n  ros__parameters:\n    overhead:\n'
                      f'      camera_position: {list(camera.position)}\n'
                      f'      camera_rotation: {list(camera.rotation)}\n', encoding='utf-8')
    assert main(['overhead', str(bag), '--params', str(params), '--out', str(tmp_path)]) == 0
    with Bag(tmp_path / 'estimates') as estimates:
        found = estimates.recording(['overhead/odom', 'overhead/wheel_slip'])
    pose, slip = found.poses(), found.slips()
    times = (pose.stamp_ns - START_NS) / NS_PER_S
    error = pose.pose - (at(times, poses.pose) - middle)
    error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
    assert np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))) < 0.002
    assert np.degrees(np.sqrt(np.mean(error[:, 2] ** 2))) < 0.2
    normalized = (pose.twist - at(times, poses.twist)) / pose.twist_sigma
    assert 0.5 < np.mean(normalized ** 2) < 1.3  # of one scene
    assert np.mean(np.abs(normalized) < 2.0) >= 0.93
    assert np.abs(normalized).max() < 5.0
    spread = np.diagonal(pose.covariance, axis1=1, axis2=2)
    assert np.abs(error / np.sqrt(spread)).max() < 5.0
    times = (slip.stamp_ns - START_NS) / NS_PER_S
    near = [at(times + shift, poses.twist) for shift in (-0.25, -0.12, 0.0, 0.12, 0.25)]
    steady = (np.abs(near[2][:, 0]) > 0.3) & (np.ptp(near, axis=0)[:, 0] < 0.03) & (
        np.ptp(near, axis=0)[:, 2] < 0.12)
    wrong = slip.ratio - np.column_stack([np.interp(
        slip.stamp_ns, slips.stamp_ns, column) for column in slips.ratio.T])
    if steady.any():
        assert np.sqrt(np.mean(wrong[steady] ** 2)) < 0.006
        assert np.abs(wrong[steady] / slip.sigma[steady]).max() < 5.0
    summary = json.loads((tmp_path / 'summary.json').read_text(encoding='utf-8'))
    offset = summary['time_offset']
    assert abs(offset['value_s']) < 4.0 * offset['sigma_s'] < 0.03
