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

"""``smart_tire identify stiffness`` on the command line."""

from __future__ import annotations

from benchmarks.scenarios import SCENARIOS
import pytest
from smart_tire.bags import BagWriter
from smart_tire.cli.main import main
from smart_tire.estimation.streams import SLIP
from smart_tire.parameters import load_files, SlipEstimatorParams, specs

INPUTS = SLIP.inputs.values()


def written(name, seed, folder):
    with BagWriter(folder / 'run') as writer:
        for receive_ns, topic, sample in SCENARIOS[name].events(seed):
            if topic in INPUTS:
                writer.write_sample(topic, receive_ns, sample)
    return folder / 'run'


def test_the_stiffness_is_identified_from_starts_and_stops(tmp_path, capsys):
    out = tmp_path / 'tire.yaml'
    bag = written('straight', 21, tmp_path)
    assert main(['identify', 'stiffness', str(bag), '--out', str(out)]) == 0
    assert 'straight segments' in capsys.readouterr().out
    known = specs(SlipEstimatorParams)
    values = load_files([out], 'slip_estimator', known, known)
    stiffness = values['tire.longitudinal_stiffness']
    sigma = values['tire.longitudinal_stiffness_sigma'] * stiffness
    assert sigma < 0.2 * stiffness
    assert stiffness == pytest.approx(52.7, abs=3.0 * sigma)
    assert out.with_suffix('.png').read_bytes().startswith(b'\x89PNG')


def test_a_recording_of_turns_only_fails_with_the_reason(tmp_path, capsys):
    out = tmp_path / 'tire.yaml'
    assert main(['identify', 'stiffness', str(written('concrete', 21, tmp_path)),
                 '--out', str(out)]) == 1
    assert 'straight' in capsys.readouterr().err
    assert not out.exists()
