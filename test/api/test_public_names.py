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
The stable names: a change of this file that is not an addition needs a new major version.

See docs/reference/api.md for the policy.
"""

from __future__ import annotations

import dataclasses
import doctest
import importlib
import inspect
import re
import subprocess
import sys

import pytest

import smart_tire
from smart_tire import api

pytestmark = pytest.mark.processes

SIGNATURES = {  # without annotations
    'BrushTire': '(*, stiffness=52.7, load=26.7)',
    'BrushTire.adhesion_ratio': '(self, slip, friction)',
    'BrushTire.critical_slip': '(self, friction)',
    'BrushTire.force': '(self, s_x, s_y, friction)',
    'BrushTire.friction': '(self, adhesion_ratio, slip)',
    'BucklingFilm': "(*, length, width, thickness, material=<factory>, convention='exact')",
    'BucklingFilm.deflection': '(self, stroke)',
    'BucklingFilm.deflection_from_charge': '(self, charge)',
    'BucklingFilm.normalized_charge': "(self, deflection, model='exact')",
    'BucklingFilm.stroke': '(self, deflection)',
    'FilmSensor': '(*, params=<factory>)',
    'FilmSensor.charge': '(self, deflection)',
    'FilmSensor.load': '(path)',
    'FilmSensor.measure': '(self, time, charge, *, used=False)',
    'FrictionEstimate.columns': '(self)',
    'FrictionEstimate.of': '(self, wheel)',
    'FrictionEstimate.to_pandas': '(self, origin_ns=None)',
    'Recording': '(imu, wheels, films=<factory>, truth=<factory>, warnings=(), order=None, '
                 'params=None)',
    'Recording.received': '(self)',
    'Recording.tables': '(self)',
    'Recording.to_pandas': '(self, origin_ns=None)',
    'SlipEstimate.at': '(self, stamp_ns)',
    'SlipEstimate.columns': '(self)',
    'SlipEstimate.to_pandas': '(self, origin_ns=None)',
    'TreadFilm': '(*, length=0.02, contact_length=0.046, bending_peak=0.83, bending_alpha=67.0, '
                 "stretch_gain=307.5, release='fig8', recovery=0.005)",
    'TreadFilm.of': '(params, wheel, film=0)',
    'TreadFilm.voltage': '(self, position, *, slip, critical_slip, total_slip=None)',
    'estimate': '(recording, params=None)',
    'estimate_friction': '(recording, params=None)',
    'estimate_slip': '(recording, params=None)',
    'fit_crossing': '(time, volts, wheel_speed, *, params=None, wheel=None, film=0, load=None, '
                    'lateral_slip=0.0, speed_sigma=0.01, length_sigma=0.1)',
    'load_params': '(*files, values=None)',
    'plot': '(estimates, truth=None)',
    'read_bag': '(path, *, params=None, remap=None)',
    'simulate': '(speeds, duration, *, params=None, seed=None, wheel_rate=16.0, torque=True, '
                'ground=None)',
    'write_bag': '(path, recording)',
}
FIELDS = {
    'CrossingFit': 'time slip normalized_slip adhesion_ratio adhesion_length contact_length '
                   'contact_angle tread_deflection friction_coefficient residual',
    'Estimates': 'pose slip center ground friction',
    'FilmData': 'stamp_ns wheel volts receive_ns',
    'FilmMeasurement': 'time value sigma',
    'FrictionEstimate': 'stamp_ns wheel friction_coefficient friction_coefficient_single '
                        'adhesion_ratio adhesion_length stretch_voltage peak_interval slip '
                        'film_slip total_slip normal_load stiffness critical_slip traction_force',
    'GroundEstimate': 'stamp_ns stiffness friction_coefficient rolling_resistance lateral_share '
                      'lateral_stiffness_ratio center_of_mass_x center_of_mass_y imu_x imu_y '
                      'motor_friction torque_scale friction_common_sigma change_age',
    'ImuData': 'stamp_ns acceleration rate orientation receive_ns',
    'Params': 'estimators simulator',
    'PoseEstimate': 'stamp_ns pose twist covariance twist_sigma',
    'Quantity': 'value sigma',
    'RotationCenter': 'stamp_ns position',
    'SlipEstimate': 'stamp_ns ratio sigma velocity',
    'Truth': 'pose slip friction',
    'WheelData': 'stamp_ns velocity position effort receive_ns',
}


def resolve(name: str):
    """Return a public object by its dotted name."""
    found = smart_tire
    for part in name.split('.'):
        found = getattr(found, part)
    return found


def bare(signature: inspect.Signature) -> str:
    """Return a signature without annotations."""
    parameters = [one.replace(annotation=inspect.Parameter.empty)
                  for one in signature.parameters.values()]
    return str(inspect.Signature(parameters))


def public_methods(kind: type) -> list[str]:
    """Return the methods of a class that a user may call."""
    return [key for key, value in inspect.getmembers(kind)
            if (inspect.isfunction(value) or inspect.ismethod(value)) and not key.startswith('_')]


def test_the_public_names_are_these():
    assert sorted(smart_tire.__all__) == sorted({name.split('.')[0] for name in SIGNATURES}
                                                | {'SlipEstimate', 'FrictionEstimate'})
    assert set(smart_tire.__all__) <= set(api.__all__)
    for name in smart_tire.__all__:
        assert getattr(smart_tire, name) is getattr(api, name)


@pytest.mark.parametrize('name', SIGNATURES)
def test_a_signature_is_stable(name):
    assert bare(inspect.signature(resolve(name))) == SIGNATURES[name]


def test_no_public_method_is_missing_from_the_signatures():
    for name in smart_tire.__all__:
        if inspect.isclass(kind := getattr(smart_tire, name)):
            assert [method for method in public_methods(kind)
                    if f'{name}.{method}' not in SIGNATURES] == []


@pytest.mark.parametrize('name', FIELDS)
def test_the_fields_of_a_class_are_stable(name):
    assert [item.name for item in dataclasses.fields(getattr(api, name))] == FIELDS[name].split()


def test_help_of_the_estimators_states_units_and_shapes():
    for name in 'estimate_slip', 'estimate_friction', 'simulate':
        text = inspect.getdoc(resolve(name))
        assert re.search(r'\(n,( [34])?\)', text) and re.search(r'\[(ns|-|m/s|N|s|rad/s)\]', text)
    for kind in (api.PoseEstimate, api.SlipEstimate, api.ImuData, api.WheelData):
        for item in dataclasses.fields(kind):
            assert f'* ``{item.name}``: (n,' in inspect.getdoc(kind), item.name


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'smart_tire' has no attribute 'estimat'"):
        _ = smart_tire.estimat
    assert set(smart_tire.__all__) <= set(dir(smart_tire))


def test_importing_the_package_imports_no_library():
    code = ('import sys, smart_tire\n'
            "print([name for name in sys.modules if name.split('.')[0] in "
            "('numpy', 'scipy', 'pandas', 'matplotlib', 'yaml')"
            " or name.startswith('smart_tire.')])")
    found = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                           check=True)
    assert found.stdout.strip() == '[]'


@pytest.mark.parametrize('name', ['smart_tire', 'smart_tire.api.models'])
def test_the_examples_in_docstrings_are_true(name):
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted >= 2 and result.failed == 0
