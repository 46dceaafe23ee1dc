# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tests of the viewer are skipped if rerun is not installed."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

if find_spec('rerun') is None:
    collect_ignore_glob = ['test_*.py']


@pytest.fixture
def recorded(tmp_path: Path) -> Callable[..., Any]:
    """Return a function that feeds a scene and returns what its recording contains."""
    import rerun as rr
    from smart_tire.parameters import build, RobotParams
    from smart_tire.view.scene import Scene
    from support.rerun_file import RerunFile

    def record(feed: Callable[[Scene], None], **params: Any) -> RerunFile:
        path = tmp_path / 'scene.rrd'
        stream = rr.RecordingStream('test')
        stream.save(path)
        scene = Scene(stream, build(RobotParams, params))
        feed(scene)
        scene.finish()
        stream.disconnect()
        return RerunFile(path)

    return record
