# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Layouts for other tools refer to existing topics, fields, joints and quantities."""

from __future__ import annotations

import json
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

import pytest
from smart_tire.bags.cdr import typestore
from smart_tire.messages import TOPICS
from smart_tire.messages.joint_state import film_names, GROUND_QUANTITIES
from smart_tire.messages.path import PROGRESS_NAMES
from smart_tire.samples import FRICTION_QUANTITIES, GoalPose, WHEELS

FOLDER = Path(__file__).resolve().parents[1] / 'config' / 'view'
FOXGLOVE = json.loads((FOLDER / 'foxglove.json').read_text(encoding='utf-8'))
PLOTJUGGLER = ElementTree.parse(FOLDER / 'plotjuggler.xml').getroot()
JOINTS = 'sensor_msgs/msg/JointState'
FILMS = tuple(name for wheel in WHEELS for name in film_names(wheel, 2))
NAMES = {'tire_samples': FILMS, 'tire_friction': FRICTION_QUANTITIES,
         'ground_truth/tire_friction': FRICTION_QUANTITIES, 'ground_state': GROUND_QUANTITIES,
         'path_progress': PROGRESS_NAMES}
FOXGLOVE_PATH = re.compile(r'/(?P<topic>[\w/]+)(\{header\.frame_id=="(?P<frame>\w+)"\})?'
                           r'\.(?P<fields>[\w.]+)(\[(?P<index>\d+)\])?')


def names(topic: str) -> tuple[str, ...]:
    """Return the names in the JointState messages of a topic."""
    return NAMES.get(topic, WHEELS)


def has_field(type_name: str, fields: list[str]) -> bool:
    """Return whether messages of a type have a nested field."""
    for field in fields:
        found = dict(typestore().get_msgdef(type_name).fields)
        if field not in found:
            return False
        type_name = str(found[field][1])
    return True


def foxglove_paths() -> list[str]:
    """Return the message paths of all plots."""
    plots = [panel for name, panel in FOXGLOVE['configById'].items() if name.startswith('Plot!')]
    return [path['value'] for plot in plots
            for path in (*plot['paths'], *filter(None, [plot.get('xAxisPath')]))]


@pytest.mark.parametrize('path', foxglove_paths())
def test_a_path_of_foxglove_exists(path):
    match = FOXGLOVE_PATH.fullmatch(path)
    assert match is not None
    topic = TOPICS[match['topic']]
    assert has_field(topic.type, match['fields'].split('.'))
    assert (match['frame'] in WHEELS) == (topic.frame == '')  # several wheels share the topic
    if topic.type == JOINTS:
        count = 2 if topic.name == 'tire_samples' else len(names(topic.name))
        assert 0 <= int(match['index']) < count
    else:
        assert match['index'] is None


def curves() -> list[str]:
    """Return the series of all plots of PlotJuggler."""
    return [name for curve in PLOTJUGGLER.iter('curve')
            for name in ([curve.attrib['curve_x'], curve.attrib['curve_y']]
                         if 'curve_x' in curve.attrib else [curve.attrib['name']])]


@pytest.mark.parametrize('series', curves())
def test_a_series_of_plotjuggler_exists(series):
    name = max((name for name in TOPICS if series.startswith(f'/{name}/')), key=len)
    parts = series.removeprefix(f'/{name}/').split('/')
    if TOPICS[name].type == JOINTS:
        joint, field = parts
        assert joint in names(name)
        assert field in ('position', 'velocity', 'effort')
    else:
        assert has_field(TOPICS[name].type, parts)


def panels(node: Any) -> list[str]:
    """Return the panels of a part of the layout of Foxglove."""
    return [node] if isinstance(node, str) else [*panels(node['first']), *panels(node['second'])]


def test_every_panel_of_foxglove_is_placed_once():
    assert sorted(panels(FOXGLOVE['layout'])) == sorted(FOXGLOVE['configById'])


def test_other_topics_of_foxglove_exist():
    for panel in FOXGLOVE['configById'].values():
        for topic in panel.get('topics', ()):
            assert topic.strip('/') in TOPICS
    assert FOXGLOVE['configById']['DiagnosticSummary!nodes']['topicToRender'] == '/diagnostics'


def test_the_3d_panel_of_foxglove_shows_the_path_and_publishes_goals_in_odom():
    panel = FOXGLOVE['configById']['3D!robot']
    assert panel['topics']['/path']['visible']
    assert panel['followTf'] == 'odom'
    assert panel['publish']['type'] == 'pose'
    assert TOPICS[panel['publish']['poseTopic'].strip('/')].sample is GoalPose


def test_sizes_of_plotjuggler_match_the_number_of_areas():
    for splitter in PLOTJUGGLER.iter('DockSplitter'):
        assert len(splitter) == int(splitter.attrib['count'])
        assert len(splitter.attrib['sizes'].split(';')) == len(splitter)
