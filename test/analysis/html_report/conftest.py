# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The analysis of a short simulated drive with odd names, and its report."""

from __future__ import annotations

from dataclasses import replace

import pytest

from smart_tire.analysis.html_report.content import report_of
from smart_tire.analysis.html_report.page import html_page
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import BagParams, EstimatorParams, FILES
from smart_tire.bags import BagWriter, channel_of
from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate

ODD_NAME = 'drive <b>&"1"</b></script>'
ODD_TOPIC = '/odd<i>&amp;'
PARAMS = '/**: {ros__parameters: {film: {wheels: [front_left]}, wheel_radius: 0.087}}'


@pytest.fixture(scope='session')
def params(tmp_path_factory):
    """Return the parameter file of the drive."""
    path = tmp_path_factory.mktemp('params') / 'robot.yaml'
    path.write_text(PARAMS)
    return path


@pytest.fixture(scope='session')
def analysis(params, tmp_path_factory):
    """Return the analysis of four seconds; the bag has a topic with an odd name."""
    path = tmp_path_factory.mktemp('reported') / 'drive'
    events = simulate(build(SimulatorParams, {'film.wheels': ['front_left'], 'seed': 2}),
                      [(0.5, 120.0, 60.0)], 4.0)
    with BagWriter(path) as writer:
        for receive_ns, topic, sample in events:
            writer.write_sample(topic, receive_ns, sample)
        writer.add_topic(replace(channel_of('odd', 'std_msgs/msg/Bool'), topic=ODD_TOPIC))
        writer.write(ODD_TOPIC, events[-1][0], b'\x00\x01\x00\x00\x01')
    return analyze(path, None, EstimatorParams.load([params]))


@pytest.fixture(scope='session')
def used(params):
    """Return the parameters of the analysis and their source."""
    return BagParams(EstimatorParams.load([params]), FILES, (str(params),))


@pytest.fixture(scope='session')
def report(analysis, used):
    """Return the report of the analysis."""
    return report_of(analysis, used, ODD_NAME, [
        ('Recorded', '2026-01-02 03:04:05 UTC'), ('Software', 'smart_tire 1.2.3')])


@pytest.fixture(scope='session')
def page(report):
    """Return the text of the HTML file."""
    return html_page(report)
