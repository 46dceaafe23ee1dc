# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The compiled slip estimator next to its source, from rest to rest."""

from pathlib import Path
import subprocess
import sys

import pytest
from smart_tire.estimation.slip.estimator import COMPILED

pytestmark = pytest.mark.processes

ESTIMATES = """
import sys
from support import compiled
if sys.argv[1:]:
    sys.meta_path.insert(0, compiled.SourceFinder)
from smart_tire.estimation.slip import estimator, kalman
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import GroundState, ImuSample, WheelSample
from smart_tire.uncertain import Uncertain
kalman.LOOPS = True  # instead of numpy, whose sums have another order
slip, ground = estimator.SlipEstimator(SlipEstimatorParams()), (50.0, 0.5, 0.02)
print(estimator.COMPILED)
for tick in range(150):  # rest, start, turn, a dropout of the IMU, stop; a torque each fourth time
    stamp_ns, time = 1_000_000_000 + 10_000_000 * tick, 0.01 * tick
    speed = min(max(8.0 * (time - 0.4), 0.0), max(8.0 * (1.4 - time), 0.0), 4.0)
    samples = [ImuSample(stamp_ns, (0.1 * (tick % 3), 0.2, 9.8), (0.0, 0.0, 0.05 * speed))]
    if 80 <= tick < 100:
        samples = []
    if tick % 5 == 0:
        angle = 0.05 * speed * tick
        samples.append(WheelSample(stamp_ns, (0.9 * speed, 1.1 * speed) * 2, (angle,) * 4,
                                   (0.01 * tick,) * 4 if tick % 4 else None))
    if tick == 50:
        samples.append(GroundState(stamp_ns, *(Uncertain(one, 0.1 * one) for one in ground)))
    for sample in samples:
        print(*slip.update(sample), sep='\\n')
"""


@pytest.mark.skipif(not COMPILED, reason='not compiled')
def test_the_compiled_estimator_computes_what_its_source_does():
    def printed(*arguments):
        return subprocess.run([sys.executable, '-c', ESTIMATES, *arguments], check=True, text=True,
                              capture_output=True, cwd=Path(__file__).parents[2]).stdout
    compiled, python = printed().splitlines(), printed('as Python').splitlines()
    assert (compiled[0], python[0]) == ('True', 'False')
    assert compiled[1:] == python[1:] and len(compiled) > 300
