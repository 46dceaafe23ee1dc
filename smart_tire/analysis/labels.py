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

"""Labels of estimates of the same recording that are drawn together."""

from __future__ import annotations

from collections.abc import Mapping

from smart_tire.analysis.series import Series

FILTERED, SMOOTHED = 'filtered', 'smoothed'

LabeledEstimates = Mapping[str, Series]  # label -> estimates, those of the filter first


def label_estimates(estimates: Series, smoothed: Series | None = None) -> LabeledEstimates:
    """Return the estimates by label."""
    return {'estimate': estimates} if smoothed is None else {
        FILTERED: estimates, SMOOTHED: smoothed}


def panel_title(labeled: LabeledEstimates, label: str, name: str) -> str:
    """Return the title of a panel; a single label is omitted."""
    return ', '.join(word for word in (name, label if len(labeled) > 1 else '') if word)
