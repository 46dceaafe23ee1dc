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
Constants of the friction estimator: value, unit, meaning, origin, and the run that needs it.

Lengths are in lengths of the film. Runs are scenarios of ``benchmarks.friction`` and files of
``test/estimation/friction``.
"""

# -- fit of the waveform: start and priors -------------------------------------------------------
BUMP_SHARE = 0.12        # of the bending peak, prior and its sigma; Fig. 11(b): 0.10-0.15; bumps
LOG_RECOVERY_SIGMA = 0.5  # of ln of the recovery length; assumed; releases fig8
LOG_ALPHA_SIGMA = 0.03   # of ln of alpha in B(15); assumed; all
SLIP_SIGMA = 3.0         # -, weak prior on slip and on normalized slip; assumed; low slip
POOR_EXCESS = 1.5        # mean squared normalized residual of a wrong start, or of a fit that
#                          contradicts the shape; release_mixed, lasting change
ROUGH_REDUCTION = 3.0    # chi-squared, last step of the fit with known bumps; CPU time
MAX_CENTER_STEP = 0.15   # film lengths, of a center in an iteration, and its largest sigma;
#                          derived: the entry is linear; all, lost batches
MIN_NORMALIZED_SLIP = 0.01  # -, the model is linear below: noise may make it negative; low slip

# -- shape of release and bumps, learned ---------------------------------------------------------
RELEASE_SIGMA = 0.2      # -, of share and size, about the configured release; release_mixed
BUMP_SIGMA = 0.6         # of a bump's shape over its height; derived: all shapes; bumps_far
CORRELATION_LENGTH = 0.15  # film lengths, of the deviations along a bump, and of their decay by
#                            e inside the contact; bumps_skewed
UNCORRELATED_SIGMA = 0.03  # of the shape at each knot; assumed; bumps_skewed
RANDOM_WALK_SHARE = 0.001  # of the initial sigmas, per crossing; assumed; lasting change
INFORMATION_SHARE = 0.5  # of a crossing's: its errors over distance are correlated; all
STEADY_SPEED_CHANGE = 0.02  # -, in a crossing, that halves the information; starts and stops
OUTLIER_SIGMAS = 5.0     # of the squared innovation, beyond which it has less weight; mu_jumps
MAX_OUTLIERS = 3         # consecutive, after which the shape has changed; lasting change

# -- what a fit shows ----------------------------------------------------------------------------
CHANGE_SIGMA = 0.01      # -, of the slip over a contact length, and least scale of a relative
#                          change; assumed; all
SLIP_CHANGE_SHARE = 0.5  # of a relative change of wheel speed, linear change of slip; stops
SLIP_RESIDUAL_SHARE = 0.05  # of that, nonlinear change of slip; starts and stops
FULL_SLIDING_ONSET = 0.8  # -, normalized slip from which the waveform hardly depends on it
FULL_SLIDING_SIGMAS = 4.0  # within which that onset counts as reached; wet tiles

# -- friction of a single crossing ---------------------------------------------------------------
POSTERIOR_POINTS = 301   # of the density of 1 / mu; derived: errors far below its sigma; noisy
MAX_CONTRADICTION = 13.8  # squared normalized difference of the films from the motion: 1 in 1000,
#                           beyond which mu is unknown: a ground that changes; slow_readings
