# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The estimators connected as in the nodes, without ROS; their parameters; the smoother."""

from __future__ import annotations

from array import array
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from smart_tire.errors import ParameterError
from smart_tire.estimation import streams
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.friction.film_stage import FilmStage, MotionBlock
from smart_tire.estimation.ground.unknowns import LENGTH
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.output import SlipOutputBuilder
from smart_tire.estimation.slip.rts_smoother import RtsSmoother
from smart_tire.estimation.slip.state import ESTIMATED
from smart_tire.parameters import (
    build, FrictionEstimatorParams, known_names, load_files, load_node, NODE_PARAMS, RobotParams,
    SlipEstimatorParams, specs)
from smart_tire.parameters.files import (
    Block, blocks_in, lines_in, read_blocks, snapshot_text, value_text, values_for)
from smart_tire.parameters.spec import is_known, values_of
from smart_tire.recording import SampleArrays
from smart_tire.samples import (
    Friction, GroundState, Icr, ImuSample, NS_PER_S, Odometry, Sample, WheelSample, WheelSlip)

if TYPE_CHECKING:
    from smart_tire.analysis.summary import Tree
    from smart_tire.bags import Bag

INPUTS, ESTIMATES = streams.INPUTS, streams.ESTIMATES
TRUTHS = tuple(f'ground_truth/{name}' for name in ('odom', 'wheel_slip', 'tire_friction'))
OVERHEAD = tuple(f'overhead/{name}' for name in ('odom', 'wheel_slip'))

FILES, BAG, DEFAULTS = 'files', 'bag', 'defaults'  # sources of a set of parameters
FROM_BAG, DEFAULT = 'the bag', 'default'  # origins of a single one, which may be a file
NODES = 'slip_estimator', 'friction_estimator'
LOST_WITHOUT = {  # input -> estimates that require it
    'imu/data': 'odom, wheel_slip, icr and ground_state', 'tire_samples': 'tire_friction',
    'wheel_states': 'odom, wheel_slip, icr, tire_friction and ground_state'}
HOLD_NS = 2 * NS_PER_S  # of inputs, until the ground of their time is known
EstimateRecord = Odometry | WheelSlip | Icr | GroundState | Friction


@dataclass(frozen=True)
class EstimatorParams:
    """Parameters of both estimators."""

    slip: SlipEstimatorParams = field(default_factory=SlipEstimatorParams)
    friction: FrictionEstimatorParams = field(default_factory=FrictionEstimatorParams)

    @classmethod
    def load(cls, files: Iterable[str | Path]) -> EstimatorParams:
        """Return the parameters in ``files``, later ones override; raise ParameterError."""
        paths = list(files)
        return cls(*(load_node(paths, node) for node in NODES))

    @classmethod
    def from_text(cls, text: str, where: str) -> EstimatorParams:
        """
        Return the parameters in the text of a parameter file, such as one stored in a bag.

        Names that are unknown to this version are ignored (``bag_params``). Raises
        ParameterError, with ``where`` the text is from, if a value is invalid.
        """
        blocks = blocks_in(text, where)
        try:
            return cls(*(build(NODE_PARAMS[node], values_for(
                node, blocks, known_names([NODE_PARAMS[node]]))) for node in NODES))
        except ParameterError as error:
            raise ParameterError(f'{where}: {error}') from error

    @property
    def text(self) -> str:
        """Return all parameters as the text of a parameter file."""
        return snapshot_text(self.by_node())

    def by_node(self) -> dict[str, dict[str, Any]]:
        """Return the flat parameters by node."""
        return dict(zip(NODES, (values_of(self.slip), values_of(self.friction))))

    @property
    def robot(self) -> RobotParams:
        """Return the robot parameters of the slip estimator."""
        return self.slip.robot


@dataclass(frozen=True)
class BagParams:
    """Parameters of the estimators and where they are from."""

    params: EstimatorParams
    source: str                      # FILES, BAG or DEFAULTS
    origins: tuple[str, ...] = ()    # files, or nodes whose parameters the bag carries
    overridden: bool = False         # the bag carries parameters, which the files replace
    unknown: tuple[str, ...] = ()    # names in the bag that no node of this version has
    given: frozenset[str] = frozenset()  # names that the slip estimator has not by default

    @property
    def radius_given(self) -> bool:
        """Return whether wheel_radius is not the default, which is that of paper B."""
        return 'wheel_radius' in self.given

    @property
    def tree(self) -> Tree:
        """Return the source of the parameters, and all with their origins, for the summary."""
        named = {} if self.source == DEFAULTS else {
            'files' if self.source == FILES else 'nodes': list(self.origins)}
        return {'source': self.source, **named, 'values': {
            node: {name: {'value': values[name], 'origin': origin}
                   for name, origin in self.origins_of(node).items()}
            for node, values in self.params.by_node().items()}}

    def origins_of(self, node: str) -> dict[str, str]:
        """Return where each parameter of ``node`` is from: file and line, FROM_BAG or DEFAULT."""
        values = self.params.by_node()[node]
        described, known = specs(NODE_PARAMS[node], values), known_names(NODE_PARAMS.values())
        if self.source == BAG:
            return {name: DEFAULT if value_text(values[name]) == value_text(spec.default)
                    else FROM_BAG for name, spec in described.items()}
        found = dict.fromkeys(described, DEFAULT)
        for file in self.origins:
            lines = lines_in(Path(file))
            found |= {name: f'{file}:{lines[name]}' for name in load_files(
                [Path(file)], node, known, described, NODE_PARAMS)}
        return found

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
                         overridden=bool(bag.parameters), given=frozenset().union(
                             *(_given(read_blocks(Path(file))) for file in files)))
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
                     unknown=tuple(_unknown_names(blocks)), given=_given(blocks))


def _given(blocks: Sequence[Block]) -> frozenset[str]:
    """Return the names of the parameters that ``blocks`` give the slip estimator."""
    return frozenset(values_for('slip_estimator', blocks, known_names([SlipEstimatorParams])))


def _unknown_names(blocks: Sequence[Block]) -> list[str]:
    """Return the parameters in ``blocks`` that no node of this version has."""
    known = known_names(NODE_PARAMS.values())
    return sorted({name for _, parameters in blocks for name in parameters
                   if not is_known(name, known)})


class Measured(NamedTuple):
    """What an input adds to the stages after that of the films."""

    blocks: list[MotionBlock]
    samples: list[Sample]  # the input, if the slip estimator needs it


def measured(films: FilmStage, sample: Sample) -> Measured:
    """Return what the stage of the films makes of an input."""
    return Measured(films.add_sample(sample) if type(sample) in streams.FRICTION.inputs else [],
                    [sample] if type(sample) in streams.SLIP.inputs else [])


def forwarded(friction: FrictionEstimator, sample: Sample) -> list[Sample]:
    """Return the estimates of an input, in order of reception, and the input if slip needs it."""
    blocks, samples = measured(friction.films, sample)
    return [*friction.evaluate(blocks), *samples]


class SmoothedSlip:
    """
    Slip estimator that also yields RTS-smoothed estimates.

    The smoother has a filter of its own, in which each state of the ground takes effect in the
    middle of the window that it was estimated from.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._smoother = RtsSmoother(ESTIMATED)
        self._estimator = SlipEstimator(params)
        self._recorded = SlipEstimator(params, self._smoother)
        self._ahead_ns = round((0.5 * LENGTH + params.ground_delay) * NS_PER_S)
        self._waiting: deque[ImuSample | WheelSample] = deque()
        self._output = SlipOutputBuilder(params)
        self._stamps: list[int] = []  # of the filter's odometry

    def update(self, sample: ImuSample | WheelSample | GroundState) -> Sequence[EstimateRecord]:
        """Process a sample; return the filter estimates that it completes."""
        if isinstance(sample, GroundState):
            self._recorded.update(replace(sample, stamp_ns=sample.stamp_ns - self._ahead_ns))
        else:
            self._waiting.append(sample)
            while self._waiting[0].stamp_ns < sample.stamp_ns - HOLD_NS:
                self._recorded.update(self._waiting.popleft())
        found = self._estimator.update(sample)
        self._stamps += [one.stamp_ns for one in found if isinstance(one, Odometry)]
        return found

    @property
    def late(self) -> Counter[str]:
        """Return topic -> number of late samples."""
        return self._estimator.late

    @property
    def restarts(self) -> int:
        """Return how often both filters started again from their priors."""
        return self._estimator.restarts + self._recorded.restarts

    def smoothed(self) -> Iterator[Sequence[EstimateRecord]]:
        """
        Yield the smoothed estimates for each odometry of ``update``, in the same order.

        There are none for instants at which the smoother's filter has restarted.
        """
        while self._waiting:
            self._recorded.update(self._waiting.popleft())
        wanted = set(self._stamps)
        states = (state for state in self._smoother.states()
                  if state.context.instant_ns in wanted)
        state = next(states, None)
        for stamp_ns in self._stamps:
            if state is None or state.context.instant_ns != stamp_ns:
                yield []
                continue
            yield self._output.build(state.context, array('d', state.x), state.P)
            state = next(states, None)

    def close(self) -> None:
        """Release the recorded filter states."""
        self._smoother.close()


def smooth(params: SlipEstimatorParams,
           samples: Iterable[Sample]) -> tuple[SampleArrays, SampleArrays]:
    """
    Return the filtered and the smoothed estimates from ``samples`` in order of reception.

    Samples other than those of IMU, wheels and ground are ignored.
    """
    filtered, slip = SampleArrays(), SmoothedSlip(params)
    for sample in samples:
        if isinstance(sample, (ImuSample, WheelSample, GroundState)):
            for estimate in slip.update(sample):
                filtered.add_sample(estimate)
    smoothed = SampleArrays(one for estimates in slip.smoothed() for one in estimates)
    slip.close()
    return filtered, smoothed


def estimates_of(slip: SlipEstimator | SmoothedSlip, sample: Sample) -> list[EstimateRecord]:
    """Return all estimates after one item of ``forwarded``, in order."""
    found: list[EstimateRecord] = []
    if isinstance(sample, (Friction, GroundState)):
        found.append(sample)
    if isinstance(sample, (ImuSample, WheelSample, GroundState)):
        found += slip.update(sample)
    return found


class Pipeline:
    """Both estimators: inputs in, estimates out."""

    def __init__(self, params: EstimatorParams) -> None:
        self._friction = FrictionEstimator(params.friction)
        self._slip = SlipEstimator(params.slip)

    def update(self, sample: Sample) -> list[EstimateRecord]:
        """Process an input, in order of reception; return the estimates that it completes."""
        return self._estimates(forwarded(self._friction, sample))

    def finish(self) -> list[EstimateRecord]:
        """Return the last estimates, at the end of all inputs."""
        return self._estimates(self._friction.finish())

    @property
    def status(self) -> dict[str, str]:
        """Return the values for diagnostics of the friction estimator."""
        return {key: str(value) for key, value in self._friction.status().items()}

    def _estimates(self, items: Iterable[Sample]) -> list[EstimateRecord]:
        return [estimate for item in items for estimate in estimates_of(self._slip, item)]
