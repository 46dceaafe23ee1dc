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
The stable Python interface: numpy arrays in, numpy arrays out.

``smart_tire`` offers the names that most programs need; the classes of their arguments and
results are here. Both follow semantic versioning; all other modules may change at any time.
"""

from smart_tire.api.crossing import CrossingFit, fit_crossing
from smart_tire.api.models import (
    BrushTire, BucklingFilm, FilmMeasurement, FilmParams, FilmSensor, TreadFilm)
from smart_tire.api.params import load_params, Params
from smart_tire.api.recording import FilmData, ImuData, read_bag, Recording, WheelData, write_bag
from smart_tire.api.runs import estimate, estimate_friction, estimate_slip, plot, simulate
from smart_tire.errors import BagError, EstimatorError, ParameterError, SmartTireError
from smart_tire.estimates import (
    Estimates, FrictionEstimate, GroundEstimate, PoseEstimate, Quantity, RotationCenter,
    SlipEstimate, Truth)
from smart_tire.samples import WHEELS
from smart_tire.uncertain import Uncertain

__all__ = [
    'BagError', 'BrushTire', 'BucklingFilm', 'CrossingFit', 'estimate', 'estimate_friction',
    'estimate_slip', 'Estimates', 'EstimatorError', 'FilmData', 'FilmMeasurement', 'FilmParams',
    'FilmSensor', 'fit_crossing', 'FrictionEstimate', 'GroundEstimate', 'ImuData', 'load_params',
    'ParameterError', 'Params', 'plot', 'PoseEstimate', 'Quantity', 'read_bag', 'Recording',
    'RotationCenter', 'simulate', 'SlipEstimate', 'SmartTireError', 'TreadFilm', 'Truth',
    'Uncertain', 'WheelData', 'WHEELS', 'write_bag']
