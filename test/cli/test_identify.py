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

"""Tests for all kinds of ``smart_tire identify``."""

from __future__ import annotations

import argparse

import pytest
from smart_tire.analysis.identify import KINDS
from smart_tire.cli import calibrate, identify


def parsed(*words):
    parser = argparse.ArgumentParser()
    identify.add_arguments(parser)
    return parser.parse_args(words)


@pytest.mark.parametrize('kind', identify.KINDS)
def test_each_kind_of_bags_has_a_function_and_steps_of_a_live_calibration(kind):
    assert parsed(kind, 'some_recording').run_kind is identify.run_bags
    assert KINDS.keys() == calibrate.STEPS_OF.keys() == identify.KINDS.keys()


def test_an_unknown_kind_is_a_usage_error_that_lists_the_known_ones(capsys):
    with pytest.raises(SystemExit) as left:
        parsed('colour', 'some_recording')
    assert left.value.code == 2
    output = capsys.readouterr().err
    assert all(kind in output for kind in identify.KINDS)
