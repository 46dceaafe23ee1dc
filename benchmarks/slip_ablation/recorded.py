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

"""Rules of the slip estimator on recordings of other robots: errors of the path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.slip.candidates import live_estimate
from benchmarks.slip.recordings import (
    align_after, bags, identified_params, read, RECORDINGS, remaining_score)
from benchmarks.slip_ablation.rules import ALL_RULES, RULES, switched_off
from smart_tire.samples import NS_PER_S

KNOWN = {recording.name: recording for recording in RECORDINGS}


@dataclass(frozen=True)
class RecordedResult:
    """Rms position errors [m] on one recording, by rule that is off."""

    name: str
    position: dict[str, float]


def present_recordings(folder: Path) -> dict[str, Path]:
    """Return name -> bag of the recordings in ``folder``."""
    return bags(folder)[0]


def run_recorded_rules(name: str, path: Path, rules: Sequence[str]) -> RecordedResult:
    """
    Return the errors of the path with all rules, and without each of ``rules``.

    The parameters are those identified with all rules.
    """
    recording = KNOWN[name]
    params = identified_params(path, recording)
    samples, truth = read(path)
    begin_ns = int(truth.stamp_ns[0]) + round(recording.initial_duration * NS_PER_S)
    position: dict[str, float] = {}
    for key in (ALL_RULES, *rules):
        rule = RULES[key]
        with switched_off(rule):
            estimate = live_estimate(samples, replace(params, **rule.params))
        position[key] = remaining_score(align_after(estimate.poses, truth, begin_ns)).rms_m
    return RecordedResult(name, position)
