# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The arrangement that is sent with a recording: all views, with units, over the right times."""

from __future__ import annotations

from pathlib import Path

import pytest

from smart_tire.samples import WHEELS
from smart_tire.view.layout import LIVE_SPAN, ViewLayout
from smart_tire.view.viewer import open_stream
from support.rerun_file import RerunFile


def views(tmp_path: Path, *, live: bool = False) -> dict[str, dict]:
    """Return name -> components of each view of a blueprint."""
    path = tmp_path / 'layout.rrd'
    stream = open_stream('a', ViewLayout(('front_left', 'front_right'), live=live).blueprint(),
                         file=path)
    stream.flush()
    stream.disconnect()
    blueprint = RerunFile(path).blueprint()
    found = {}
    for place, components in blueprint.items():
        if 'ViewBlueprint:display_name' in components:
            below = {name: value for other, parts in blueprint.items()
                     if other.startswith(place) for name, value in parts.items()}
            found.setdefault(components['ViewBlueprint:display_name'][0], below)
    return found


def test_everything_is_on_the_first_page(tmp_path):
    names = views(tmp_path)
    for wheel in WHEELS:
        assert any(name.startswith(f'Slip, {wheel} [-], ± 2 σ') for name in names)
    for start in ('Friction mu [-]', 'Stiffness C_x of the ground [N]', 'Path [m]',
                  'Friction circles and forces [N]', 'Crossing, front_left',
                  'Crossing, front_right', 'Film voltages, front_left [V]', 'Lost, bad and late',
                  'Ages', 'Events', 'Wheels: set points', 'motor_commands', 'Velocity v_x [m/s]',
                  'Yaw rate', 'path_progress: cross-track error [m]', 'path_progress: state'):
        assert any(name.startswith(start) for name in names), start


@pytest.mark.parametrize('live', [False, True])
def test_plots_of_live_data_show_the_latest_seconds_only(tmp_path, live):
    plot = next(parts for name, parts in views(tmp_path, live=live).items()
                if name.startswith('Slip, front_left'))
    if not live:
        assert 'VisibleTimeRanges:ranges' not in plot
        return
    (limits,) = plot['VisibleTimeRanges:ranges']
    assert str(-round(LIVE_SPAN * 1e9)) in str(limits)
    assert 'time' in str(limits)
