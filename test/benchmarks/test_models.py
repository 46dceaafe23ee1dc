# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Benchmark of the models: model and general method solve the same problem."""

from benchmarks import models
import pytest


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    for name, value in (('TIME_BUDGET', 0.0), ('PERIODS', 2), ('FILM_COUNT', 6),
                        ('BVP_FILM_COUNT', 3), ('CROSSING_COUNT', 2)):
        monkeypatch.setattr(models, name, value)


@pytest.mark.parametrize('measure, agree', [
    ('duhem', 1e-3), ('weightless_film', 1e-6), ('heavy_film', 1e-6), ('crossings', 1e-12)])
def test_model_and_general_method_have_the_same_result(measure, agree):
    for figure in getattr(models, measure)():
        assert figure.difference < agree, figure
        assert figure.rate > 0.0 and figure.general_rate > 0.0
