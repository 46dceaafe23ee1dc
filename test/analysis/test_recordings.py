# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Real recordings of other robots: no films, few topics, poses as ground truth."""

import pytest

from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import EstimatorParams
from support.real_recordings import real_recording

pytestmark = pytest.mark.slow

# Known parameters of the robots: geometry, IMU mounting, firm and not quite level surface, and the
# latency of the wheel messages of the Warthog.
COMMON = """
    imu: {position: [0.0, 0.0, 0.0], accel_bias: 0.5}
    differential_slip_sigma: 0.05
    slope_sigma: 0.02
"""
WARTHOG = f"""
/**:
  ros__parameters:
    wheel_radius: 0.285
    track_width: 1.08
    wheelbase: 1.05
    encoder: {{latency: 0.17, stamp_jitter: 0.02}}
{COMMON}"""
HUSKY = f"""
/**:
  ros__parameters:
    wheel_radius: 0.1651
    track_width: 0.555
    wheelbase: 0.540
{COMMON}"""


def analyzed(name, text, folder):
    """Return the analysis of a recording; skip if it is missing."""
    bag = real_recording(name)
    path = folder / 'robot.yaml'
    path.write_text(text)
    return analyze(bag, folder / 'out', EstimatorParams.load([path]))


@pytest.fixture(scope='module')
def husky(tmp_path_factory):
    """Return the analysis of the recording of the Husky."""
    return analyzed('husky_rectangle', HUSKY, tmp_path_factory.mktemp('husky'))


def test_the_pose_of_the_warthog_is_accurate_where_wheel_odometry_diverges(tmp_path):
    """For comparison, wheel odometry alone: 22.7 m rms and 9.4 rad after 153 m."""
    run = analyzed('warthog_asphalt', WARTHOG, tmp_path)
    pose = run.summary['against_truth']['pose']
    assert pose['distance_m'] == pytest.approx(153.0, rel=0.03)
    assert pose['position_rms_m'] < 1.2
    assert abs(pose['yaw_end_rad']) < 0.1 and pose['yaw']['rms'] < 0.05
    assert run.summary['inputs']['imu/data']['rate_hz'] == pytest.approx(20.0, rel=0.01)
    assert run.summary['inputs']['wheel_states']['rate_hz'] == pytest.approx(4.0, rel=0.01)


def test_the_pose_of_the_husky_is_accurate_with_its_mean_wheel_speed_only(husky):
    pose = husky.summary['against_truth']['pose']
    assert pose['distance_m'] == pytest.approx(20.4, rel=0.03)
    assert pose['position_rms_m'] < 1.2
    assert abs(pose['yaw_end_rad']) < 0.05 and pose['yaw']['rms'] < 0.02


def test_missing_inputs_are_reported(husky):
    skipped = '\n'.join(husky.contents.skipped)
    assert 'tire_samples is not in the bag' in skipped
    assert 'positions of wheel_states: missing in 488 messages' in skipped
    assert 'ground_truth/odom has no twist' in skipped
    assert husky.summary['against_truth']['pose']['twist'] is None
