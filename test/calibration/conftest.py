# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Seeds of the statistics of this folder: a few, and many in ``make check``."""

from __future__ import annotations

import pytest


@pytest.fixture(params=[pytest.param(3, id='few'),
                        pytest.param(10, id='many', marks=pytest.mark.long)])
def seeds(request):
    """Return the seeds of recordings whose errors are compared with their standard errors."""
    return range(request.param)
