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

"""``smart_tire identify motor`` on the command line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.bags import BagWriter
from smart_tire.cli.main import main
from smart_tire.parameters import load_files, specs, WheelControllerParams
from smart_tire.samples import WheelSample
from support.motors import in_step_events, truth

SEED = 31


def written(path, *, torque=True, **options):
    with BagWriter(path) as writer:
        for receive_ns, topic, sample in in_step_events(SEED, **options):
            if isinstance(sample, WheelSample) and not torque:
                sample = replace(sample, effort=None)
            writer.write_sample(topic, receive_ns, sample)
    return str(path)


def test_the_constants_are_identified_on_the_ground_and_lifted(tmp_path, capsys):
    out = tmp_path / 'motor.yaml'
    ground, lifted = written(tmp_path / 'run'), written(tmp_path / 'up', lifted=True)
    assert main(['identify', 'motor', ground, '--lifted', lifted, '--out', str(out)]) == 0
    printed = capsys.readouterr().out
    assert 'torque constant' in printed
    assert 'axle friction                   not observable' in printed
    known = specs(WheelControllerParams)
    values = load_files([out], 'wheel_controller', known, known)
    sigma = values['motor.torque_constant_sigma']
    true = 1.2 * float(np.mean(truth(SEED)[0]))
    assert sigma <= 0.025
    assert values['motor.torque_constant'] == pytest.approx(true, rel=2.0 * sigma)
    assert values['motor.inertia'] == pytest.approx(0.008, rel=0.2)
    assert values['pid.feed_forward'] == pytest.approx(1.0 / 22.0, rel=0.02)
    assert values['pid.stall_torque'] == pytest.approx(5.0, rel=0.06)
    assert 'up' in out.read_text(encoding='utf-8').splitlines()[0]
    assert out.with_suffix('.png').read_bytes().startswith(b'\x89PNG')


def test_a_recording_without_torque_fails_with_the_reason(tmp_path, capsys):
    out = tmp_path / 'motor.yaml'
    bag = written(tmp_path / 'run', torque=False)
    assert main(['identify', 'motor', bag, '--out', str(out)]) == 1
    assert 'without motor torque' in capsys.readouterr().err
    assert not out.exists()
