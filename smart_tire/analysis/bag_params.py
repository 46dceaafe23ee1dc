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

"""Parameters to analyze a bag with: those of given files, or those that the bag carries."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.analysis.summary import Tree
from smart_tire.bags import Bag
from smart_tire.errors import ParameterError
from smart_tire.parameters import known_names, NODE_PARAMS
from smart_tire.parameters.files import Block, blocks_in
from smart_tire.parameters.spec import is_known

FILES, BAG, DEFAULTS = 'files', 'bag', 'defaults'


@dataclass(frozen=True)
class BagParams:
    """Parameters of the estimators and where they are from."""

    params: EstimatorParams
    source: str                      # FILES, BAG or DEFAULTS
    origins: tuple[str, ...] = ()    # files, or nodes whose parameters the bag carries
    overridden: bool = False         # the bag carries parameters, which the files replace
    unknown: tuple[str, ...] = ()    # names in the bag that no node of this version has

    @property
    def tree(self) -> Tree:
        """Return the source of the parameters for the summary."""
        if self.source == DEFAULTS:
            return {'source': DEFAULTS}
        return {'source': self.source,
                'files' if self.source == FILES else 'nodes': list(self.origins)}

    @property
    def origin(self) -> str:
        """Return the source of the parameters as text."""
        names = ', '.join(self.origins)
        if self.source == FILES:
            return names + (' (instead of those in the bag)' if self.overridden else '')
        if self.source == BAG:
            return 'from the bag' + (f' (recorded with {names})' if names else '')
        return 'defaults (the bag carries none; --params FILE gives others)'

    def lines(self) -> Iterator[str]:
        """Yield the source of the parameters and warnings about it, as text."""
        yield f'parameters: {self.origin}'
        if self.unknown:
            yield (f'warning: parameters in the bag are unknown to this version and ignored: '
                   f'{", ".join(self.unknown)}')


def bag_params(bag: Bag, files: Sequence[Path] = ()) -> BagParams:
    """
    Return the parameters in ``files``, later ones override; without files those in ``bag``.

    Files replace the parameters in the bag entirely. Raises ParameterError if a file or the
    parameters in the bag are invalid.
    """
    if files:
        return BagParams(EstimatorParams.load(files), FILES, tuple(map(str, files)),
                         overridden=bool(bag.parameters))
    if not bag.parameters:
        return BagParams(EstimatorParams(), DEFAULTS)
    where = f'{bag.path}: parameters in the bag'
    try:
        blocks = blocks_in(bag.parameters, where)
        params = EstimatorParams.from_text(bag.parameters, where)
    except ParameterError as error:
        raise ParameterError(f'{error}; give a parameter file with --params') from error
    names = (block.rsplit('/', 1)[-1] for block, _ in blocks)
    return BagParams(params, BAG, tuple(name for name in names if name in NODE_PARAMS),
                     unknown=tuple(_unknown_names(blocks)))


def _unknown_names(blocks: Sequence[Block]) -> list[str]:
    """Return the parameters in ``blocks`` that no node of this version has."""
    known = known_names(NODE_PARAMS.values())
    return sorted({name for _, parameters in blocks for name in parameters
                   if not is_known(name, known)})
