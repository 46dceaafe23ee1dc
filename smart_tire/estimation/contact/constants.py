# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Constants of contact: value, unit, meaning, origin, and the run that needs it.

Lengths are in lengths of the film (20 mm in paper B). Runs are scenarios of
``benchmarks.friction`` and scripted drives of ``test/estimation/friction/test_estimator.py``.
"""

import numpy as np

# -- trajectory of the wheel ---------------------------------------------------------------------
SMOOTHING_NS = 400_000_000  # used before and after an interval; derived: twice the filter; all
MAX_SILENCE_NS = 500_000_000  # extrapolated beyond the newest angle; assumed; silent wheels
MIN_STEP_NS = 1_000_000    # between angles; derived: closer ones make smoothing singular; stamps
HISTORY_LENGTH = 1024      # angles kept, grid steps at once; derived: LOOKBACK at 200 Hz; start
SEGMENT_POINTS = 200       # over a segment's distance; derived: below 1 mm; stops
ORDERS = np.arange(2, 14)  # of Legendre polynomials; 0 is a shift, 1 a scale error; slow drives
PHASES = 0.1 * np.arange(2401)  # integration variable, frequency times duration; all
MIN_SHAPE_SIGMA = 1e-4     # of the wheel radius; derived: 1 mV at the steepest edge; CPU time
MIN_REVERSAL = 0.15        # film lengths rolled back; derived: more than timestamp jitter; stops
MIN_FILM_SPEED = 0.1       # film lengths per s, slower films sample nothing new; waits

# -- blocks --------------------------------------------------------------------------------------
BLOCK_NS = 48_000_000      # of message time, six grid steps, processed together; CPU time
SETTLING_NS = 100_000_000  # before the newest angle, and least step of the trajectory; all
STANDSTILL_NS = 200_000_000  # without motion, after which nothing is awaited; assumed; braking
REMEMBERED = 64            # gaps, reversals, segments, detections, and crossings predicted at
#                            once; bounds the work; implausible spin

# -- timestamps and segments of the films --------------------------------------------------------
AVERAGING_SAMPLES = 200    # over which errors of batch timestamps average out; derived; all
GAP_PERIODS = 2.5          # sample periods: a longer step is a gap; derived; radio loss
ACTIVITY_SHARE = 0.25      # of the bending peak; derived: bumps stay below half of that; all
CLOSING = 1.75             # film lengths of silence after a segment: braking shows 1.3; braking
OUTER_LENGTH = 1.5         # film lengths of samples outside the contact: bumps, recovery; all
MAX_ACTIVE_CROSSINGS = 2.5  # of activity, then the baseline has moved; derived; wrong baseline

# -- detection -----------------------------------------------------------------------------------
MIN_SAMPLES = 8            # of a crossing, or of a median; assumed; radio loss
SEARCH_STEP = 0.125        # film lengths, between tried centers; from simulations; CPU time
MAX_SEARCH_SAMPLES = 60    # longer segments are decimated; CPU time; braking
TABLE_STEPS = 25           # entries of the waveform table in that step; derived: 1 mV; all
NORMALIZED_SLIPS = np.array([0.15, 0.5, 1.0])  # of the templates; from simulations; slip
ENTRY_SHARE = 0.75         # of a film: before, the signal is small and bumps disturb; bumps_far
BENDING_SIGMA = 0.5        # -, of the bending peak: it varies by cycle; Fig. 11(b); all
MAX_BENDING_RATIO = 3.0    # of the bending peak to the nominal one, or inverse; other signals
MAX_RESIDUAL = 0.2         # of the bending peak, rms; derived: of other signals; other signals
POSITION_GATE = 0.5        # film lengths from the predicted position; derived; sparse samples
MIN_EXPECTED_COVERAGE = 0.3  # of a crossing that is expected; assumed; radio loss
MIN_FREE_COVERAGE = 0.7    # of one that is not, or of samples that would show one; radio loss

# -- prediction and assembly ---------------------------------------------------------------------
RECURSIVE_GAIN = 0.2       # share of a detection in the mounting position, of a median in the
#                            baseline; assumed; slow drift, wrong baseline
MIN_DETECTIONS = 2         # consistent ones, to trust the position or to replace it; assumed; lost
LOOKBACK_REVOLUTIONS = 2.5  # before the first detection, that are reported; assumed; start
CLEARANCE = 0.05           # film lengths between film and patch: timestamp jitter; rolling in
MAX_SPEED_CHANGE = 0.7     # relative, in a crossing whose waveform is fitted; assumed; stops
