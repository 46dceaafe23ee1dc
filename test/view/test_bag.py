# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings: which estimates are shown, folders of demo and analysis, progress."""

from __future__ import annotations

import json

import pytest

from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.bags import BagWriter
from smart_tire.errors import BagError
from smart_tire.messages import topic_of
from smart_tire.samples import ImuSample, WheelSample, WheelSlip
from smart_tire.view.bag import find_bags, show
from support import ideal_robot

START = 1_700_000_000_000_000_000


class FakeScene:
    """Keeps what it is given."""

    topics = ('imu/data', 'wheel_states', 'odom', 'wheel_slip')

    def __init__(self):
        self.samples, self.flushes, self.finished = [], 0, False

    def add_sample(self, topic, sample):
        self.samples.append((topic, sample))

    def flush(self):
        self.flushes += 1

    def finish(self):
        self.finished = True


def write(folder, *samples):
    with BagWriter(folder) as bag:
        for sample in samples:
            bag.write_sample(topic_of(sample), sample.stamp_ns, sample)
    return folder


def sensors(count=100):
    for i in range(count):
        stamp_ns = START + i * 10_000_000
        yield ImuSample(stamp_ns, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0))
        if i % 6 == 0:
            yield WheelSample(stamp_ns, (0.0,) * 4, (0.0,) * 4)


def odometry(x, stamp_ns=START):
    return ideal_robot.odometry(stamp_ns, x)


def slip(stamp_ns=START):
    return WheelSlip(stamp_ns, (0.25,) * 4, (0.0,) * 4, (0.1,) * 4)


def shown(bag, estimates=None, *, estimate=False):
    """Return the scene, the description and the progress of showing a bag."""
    scene, lines, shares = FakeScene(), [], []
    show(bag, estimates, scene, EstimatorParams(), estimate=estimate,
         describe=lines.append, progress=shares.append)
    assert scene.finished
    return scene, lines, shares


def of_topic(scene, topic):
    return [sample for name, sample in scene.samples if name == topic]


def test_recorded_estimates_are_shown_as_they_are(tmp_path):
    bag = write(tmp_path / 'drive', *sensors(3), odometry(4.0), slip())
    scene, (line,), shares = shown(bag)
    assert line == f'{bag}: recorded estimates'
    assert [sample.position[0] for sample in of_topic(scene, 'odom')] == [4.0]
    assert of_topic(scene, 'wheel_slip') == [slip()]
    assert shares[-1] == 1.0


def test_without_estimates_the_estimators_are_run(tmp_path):
    bag = write(tmp_path / 'drive', *sensors())
    scene, (line,), _ = shown(bag)
    assert line == f'{bag}: estimates computed now with these parameters (the bag has none)'
    assert len(of_topic(scene, 'odom')) > 100
    assert len(of_topic(scene, 'imu/data')) == 100


def test_recorded_estimates_are_replaced_on_request(tmp_path):
    bag = write(tmp_path / 'drive', *sensors(), odometry(4.0), slip())
    scene, (line,), _ = shown(bag, estimate=True)
    assert line == f'{bag}: estimates computed now with these parameters'
    assert max(abs(sample.position[0]) for sample in of_topic(scene, 'odom')) < 1.0


def test_estimates_of_an_analysis_replace_the_recorded_ones_in_order_of_time(tmp_path):
    bag = write(tmp_path / 'drive', *sensors(), odometry(4.0), slip())
    middle = START + 505_000_000
    write(tmp_path / 'out' / 'estimates', odometry(7.0, middle), slip(middle))
    (tmp_path / 'out' / 'summary.json').write_text(json.dumps({'bag': str(bag)}))
    scene, (line,), _ = shown(*find_bags(tmp_path / 'out' / 'estimates'))
    assert line == f'{bag}: estimates of {tmp_path / "out" / "estimates"}'
    assert [sample.position[0] for sample in of_topic(scene, 'odom')] == [7.0]
    stamps = [sample.stamp_ns for _, sample in scene.samples]
    assert stamps == sorted(stamps)
    assert len(stamps) > 100


def test_other_bags_and_an_analysis_without_its_bag_are_shown_alone(tmp_path):
    estimates = write(tmp_path / 'out' / 'estimates', odometry(7.0), slip())
    summary = tmp_path / 'out' / 'summary.json'
    summary.write_text('{"bag": "/does/not/exist"}')
    assert find_bags(estimates) == (estimates, None)
    summary.write_text(f'{{"bag": "{estimates}"}}')
    other = write(tmp_path / 'out' / 'bag', odometry(1.0))
    assert find_bags(other) == (other, None)
    summary.unlink()
    assert find_bags(estimates) == (estimates, None)


@pytest.mark.parametrize('text', ['no json', '{}', '[]'])
def test_a_damaged_summary_is_reported(tmp_path, text):
    write(tmp_path / 'estimates', odometry(7.0))
    (tmp_path / 'summary.json').write_text(text)
    with pytest.raises(BagError, match='not the summary of an analysis'):
        find_bags(tmp_path / 'estimates')
