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
What the calibrations know before a recording: one table, with unit and origin.

``PRIORS`` has values and standard deviations of what a fit estimates in addition to its result, or
takes as it is. ``LIMITS`` has the standard errors that results must reach: those of what is known
without them, or those up to which they are useful.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from smart_tire.errors import EstimatorError
from smart_tire.uncertain import MAX_RELATIVE_SIGMA, Uncertain

RELATIVE = 'relative'


class Known(NamedTuple):
    """A value with its standard deviation, where it comes from, and the fit that needs it."""

    sigma: float
    unit: str
    origin: str  # data sheet, derived, or assumed; and why
    mean: float | None = None  # None: 1 of a relative value, 0 of others

    @property
    def value(self) -> float:
        """Return the value."""
        return float(self.unit == RELATIVE) if self.mean is None else self.mean

    @property
    def prior(self) -> tuple[float, float]:
        """Return value and standard deviation."""
        return self.value, self.sigma


UNINFORMATIVE = Known(1.0, 'ln, m or relative', 'uninformative: a factor of e, any place', 0.0)

PRIORS: Mapping[str, Known] = {
    # latency and track
    'radius difference of the sides': Known(0.05, '-', 'assumed: tire pressure'),
    'share of side slip lost in turns': Known(0.3, '-', 'assumed', 0.3),
    'wheel latency': Known(0.03, 's', 'half a period of encoders at 16 Hz'),
    'IMU latency': Known(0.001, 's', 'assumed: its filter and sampling'),
    # reference
    'slip of free rolling': Known(0.01, '-', 'assumed: its variation'),
    'lateral offset of the reference': Known(0.3, 'track', 'assumed'),
    'yaw misalignment of the reference': Known(0.05, 'rad', 'assumed'),
    # centers of rotation
    'ground speed over wheel speed': Known(0.1, RELATIVE, 'assumed: slip in turns'),
    'delay of body roll': Known(0.03, 's', 'assumed: natural frequency of 5 Hz'),
    'lateral effects of the squared yaw rate': Known(0.2, 'm', 'assumed: y of the IMU'),
    # recordings of robots whose IMU was not measured
    'position of the IMU': UNINFORMATIVE,
    # motors; loads are r m g / 4
    'motor parameters': Known(0.1, RELATIVE, 'data sheets'),
    'friction and offset of a torque': Known(0.05, 'load', 'assumed: viscous, at top speed'),
    'delay of boards': Known(0.002, 's', 'assumed: radio; boards are read in turn', 0.002),
    'scale of the accelerometer': Known(0.005, RELATIVE, 'data sheets of MEMS sensors'),
    'inertia without motor_commands': Known(0.06, RELATIVE, 'simulations: 16 of 50 Hz'),
    # stiffness
    'rolling radius': Known(0.02, RELATIVE, 'real robots roll with 0.95 to 0.97 of theirs'),
    'acceleration on straight lines': Known(0.05, '-', 'pitching of 0.3 deg at 1 m/s2'),
    # films
    'change of slip': Known(0.0005, 'over a contact length', 'steady motion; assumed'),
    'ln of alpha K': Known(5.0, '-', 'uninformative: film on a stand'),
    'latency of films': Known(0.003, 's', 'assumed: against the wheels'),
    'length of a film': Known(0.005, RELATIVE, '0.1 mm of 20 mm'),
    'ln of alpha': Known(0.3, '-', 'paper: shape of bending')}

SHARE = Known(0.1, RELATIVE, 'production tolerance; measured by hand')  # without a prior
LIMITS: Mapping[str, Known] = {
    'wheel latency': PRIORS['wheel latency'],
    'rolling radius': PRIORS['rolling radius'],
    **dict.fromkeys(('effective track', 'gyro scale', 'feed-forward', 'film gain',
                     'contact length'), SHARE),
    'S': Known(MAX_RELATIVE_SIGMA, 'wheelbase', 'axles limit its range'),
    'viscous friction': Known(MAX_RELATIVE_SIGMA, 'Coulomb friction', 'assumed: at top speed'),
    'film position': Known(0.003, 'm', 'placed by hand')}


def require(name: str, estimate: Uncertain, cause: str = '', *, factor: float = 1.0,
            scale: float = 1.0) -> Uncertain:
    """
    Return an estimate, whose standard error must be within the limit for ``name``.

    The limit is ``factor`` times larger, and in units of ``scale``. Raises EstimatorError.

    >>> require('gyro scale', Uncertain(1.0, 0.01))
    Uncertain(value=1.0, sigma=0.01)
    """
    limit = LIMITS[name]
    relative = limit.unit == RELATIVE
    error = estimate.sigma / (abs(estimate.value) if relative else scale)
    if error <= factor * limit.sigma:
        return estimate
    shown, most = (f'{value:.1%}' if relative else f'{value:.2g} {limit.unit}'
                   for value in (error, factor * limit.sigma))
    raise EstimatorError(
        f'standard error of {shown}, expected at most {most}' + (cause and f': {cause}'))
