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

"""
Ablation of the slip estimator: change of its errors with each special rule off.

Every rule is switched off alone, on the same runs and random numbers. A rule that changes nothing
beyond the scatter of seeds is not needed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
import json
from pathlib import Path
from typing import Any

from benchmarks.command import accuracy_parser, DATA, run_accuracy_benchmark
from benchmarks.friction.forces import inputs_of, VARIANTS
from benchmarks.friction.ground_scenarios import GROUND_SCENARIOS
from benchmarks.friction.methods import Event, ground_truth
from benchmarks.jobs import make_folder, run_jobs
from benchmarks.scenarios import Scenario, SCENARIOS
from benchmarks.slip.series import as_estimate, as_truth, EstimateSeries
from benchmarks.slip_ablation.recorded import (
    KNOWN, present_recordings, RecordedResult, run_recorded_rules)
from benchmarks.slip_ablation.rules import ALL_RULES, Rule, RULES, switched_off
from benchmarks.slip_ablation.scoring import CaseKey, Change, change, FIGURES, Scores, scores_of
from benchmarks.tables import markdown, new_console, new_table, number, print_all
from rich.table import Table
from rich.text import Text
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.analysis.summary import plain
from smart_tire.parameters import FrictionEstimatorParams, SlipEstimatorParams

RUNS: Mapping[str, Scenario] = {**SCENARIOS, **GROUND_SCENARIOS}
TITLES = {**{name: scenario.title for name, scenario in RUNS.items()},
          **{name: recording.title for name, recording in KNOWN.items()}}
DEFAULT_RUNS = ('concrete', 'sand', 'sweep_60', 'mu_jumps', 'figure_eight', 'stop_and_go',
                'degraded', 'gaps', 'straight', 'spin_reverse', 'tour', 'sand_straight')
SPECIAL = [name for name in RULES if name != ALL_RULES]

NOTES = """\
Change of the rms errors and of the NEES without a rule [%]: mean over all runs, in brackets the
standard error over the seeds. worst run: the run and the variant with the largest change of the
slip error. ! beyond the scatter of seeds (two standard errors) and 1 %. Recordings: change of
the rms position error. Rules:
""" + '\n'.join(f'{name}: {RULES[name].title}' for name in SPECIAL)


@dataclass(frozen=True)
class RuleResult:
    """Scores of one run and seed by rule that is off."""

    run: str
    seed: int
    scores: dict[str, dict[str, Scores]]  # rule -> variant -> scores


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return the exit status."""
    parser = accuracy_parser('slip_ablation', 'slip estimator with each special rule off')
    parser.add_argument('--rules', nargs='+', choices=SPECIAL, default=SPECIAL,
                        metavar='RULE', help='rules to switch off (default: all)')
    parser.add_argument('--variants', nargs='+', choices=list(VARIANTS), default=list(VARIANTS),
                        metavar='VARIANT', help='no_torque, torque (default: both)')
    parser.add_argument('--data', type=Path, default=DATA, metavar='DIR',
                        help='folder with real recordings (default: %(default)s)')
    args = parser.parse_args(argv)
    return run_accuracy_benchmark(
        'slip_ablation', args, TITLES, lambda seeds, on: benchmark(AblationOptions(
            seeds, args.runs or (*DEFAULT_RUNS, *KNOWN), args.rules, args.variants, args.data,
            args.out), on))


@dataclass(frozen=True)
class AblationOptions:
    """Options of the benchmark."""

    seeds: Sequence[int]
    runs: Sequence[str]      # scenarios and recordings
    rules: Sequence[str]
    variants: Sequence[str]
    data: Path               # folder of the recordings
    out: Path


def benchmark(options: AblationOptions, machine_name: str) -> None:
    """Run all rules on all runs; print the tables and write results."""
    make_folder(options.out)
    results = list(run_jobs(_jobs(options), _label))
    simulated = [one for one in results if isinstance(one, RuleResult)]
    recorded = [one for one in results if isinstance(one, RecordedResult)]
    tree: dict[str, Any] = {'machine': machine_name, 'runs': list(options.runs),
                            'results': [asdict(one) for one in simulated],
                            'recordings': [asdict(one) for one in recorded]}
    (options.out / 'results.json').write_text(
        json.dumps(plain(tree), indent=2, allow_nan=False) + '\n', encoding='utf-8')
    tables = []
    if simulated:
        tables.append(rules_table({
            rule: [_seed_scores(simulated, seed, rule) for seed in options.seeds]
            for rule in (ALL_RULES, *options.rules)}))
    if recorded:
        tables.append(recordings_table(recorded, options.rules))
    print_all(new_console(), NOTES, tables)
    (options.out / 'rules.md').write_text('\n'.join(map(markdown, tables)), encoding='utf-8')


def _jobs(options: AblationOptions) -> list[Callable[[], RuleResult | RecordedResult]]:
    """Return the jobs, recordings and the longest runs first."""
    paths = present_recordings(options.data)
    for name in options.runs:
        if name in KNOWN and name not in paths:
            print(f'{name}: not in {options.data}, skipped (--data DIR)')
    names = sorted((name for name in options.runs if name in RUNS),
                   key=lambda name: -RUNS[name].duration)
    return [*(partial(run_recorded_rules, name, path, options.rules)
              for name, path in paths.items() if name in options.runs),
            *(partial(run_rules, name, seed, options.rules, options.variants)
              for name in names for seed in options.seeds)]


def _label(result: RuleResult | RecordedResult) -> str:
    if isinstance(result, RecordedResult):
        return TITLES[result.name]
    return f'{TITLES[result.run]}, seed {result.seed}'


def run_rules(name: str, seed: int, rules: Sequence[str], variants: Sequence[str]) -> RuleResult:
    """Return the scores of a run with all rules, and without each of ``rules``."""
    scenario = RUNS[name]
    events = scenario.events(seed)
    truth = as_truth(ground_truth(events), scenario.robot)
    scores: dict[str, dict[str, Scores]] = {}
    for rule in (ALL_RULES, *rules):
        scores[rule] = {variant: scores_of(
            _estimate(events, variant, scenario, RULES[rule]), truth,
            averaged=scenario.averaged) for variant in variants}
    return RuleResult(name, seed, scores)


def _estimate(events: Sequence[Event], variant: str, scenario: Scenario, rule: Rule
              ) -> EstimateSeries:
    params = EstimatorParams(
        replace(SlipEstimatorParams(robot=scenario.robot), **rule.params),
        FrictionEstimatorParams(robot=scenario.robot))
    with switched_off(rule):
        pipeline = Pipeline(params)
        return as_estimate(estimate for sample in inputs_of(events, variant)
                           for estimate in pipeline.update(sample))


def _seed_scores(results: Sequence[RuleResult], seed: int, rule: str) -> dict[CaseKey, Scores]:
    return {(one.run, variant): scores for one in results if one.seed == seed
            for variant, scores in one.scores[rule].items()}


def rules_table(scores: Mapping[str, Sequence[Mapping[CaseKey, Scores]]]) -> Table:
    """Return the changes by rule; ``scores`` are those of each seed."""
    base = scores[ALL_RULES]
    table = new_table('Slip estimator without a rule: change of errors [%]', 'without',
                      *FIGURES.values(), 'worst run', '')
    for rule, without in scores.items():
        if rule == ALL_RULES:
            continue
        changes = {case: change(without, base, 'slip', case) for case in base[0]}
        (run, variant), worst = max(changes.items(), key=lambda item: abs(item[1].mean))
        table.add_row(rule, *(_cell(change(without, base, figure)) for figure in FIGURES),
                      f'{run}, {VARIANTS[variant]}', _cell(worst))
    return table


def recordings_table(results: Sequence[RecordedResult], rules: Sequence[str]) -> Table:
    """Return the changes of the rms position error by rule and recording."""
    table = new_table('Recordings without a rule: change of the rms position error [%]', 'without',
                      *(result.name for result in results))
    for rule in rules:
        changes = [result.position[rule] / result.position[ALL_RULES] - 1.0 for result in results]
        table.add_row(rule, *(number(100.0 * one, 1) for one in changes))
    return table


def _cell(one: Change) -> Text:
    mean, error = (number(100.0 * value, 0 if abs(one.mean) > 0.995 else 1)
                   for value in (one.mean, one.standard_error))
    return Text(f'{mean} ({error}) !', style='red') if one.matters else Text(f'{mean} ({error})')
