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

"""Results as pandas data frames; pandas is an extra."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, TYPE_CHECKING

from smart_tire.arrays import Instants

if TYPE_CHECKING:
    import pandas as pd


class Tabular(ABC):
    """Arrays with one row per timestamp."""

    stamp_ns: Instants

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @abstractmethod
    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""

    def to_pandas(self) -> pd.DataFrame:
        """
        Return a data frame with the index ``stamp_ns`` [ns]; units are those of the arrays.

        Raises ModuleNotFoundError if pandas is not installed.
        """
        return data_frame(self.stamp_ns, self.columns())


def data_frame(stamp_ns: Instants, columns: Mapping[str, Any]) -> pd.DataFrame:
    """Return a data frame of ``columns`` (n,) at ``stamp_ns`` (n,)."""
    try:
        import pandas as pd
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            'to_pandas needs pandas, which is not installed (pip install smart_tire[pandas])',
            name='pandas') from error
    return pd.DataFrame(dict(columns), index=pd.Index(stamp_ns, name='stamp_ns'))


def by_wheel(name: str, values: Any, wheels: tuple[str, ...]) -> dict[str, Any]:
    """Return a column per wheel of ``values`` (n, wheels), named ``<name>.<wheel>``."""
    return {f'{name}.{wheel}': values[:, i] for i, wheel in enumerate(wheels)}
