# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One drive of a fleet: its bag is analyzed and written to the data set."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
import json
from pathlib import Path
import re
from typing import Any

import numpy as np

import smart_tire
from smart_tire.analysis.comparison import rows_of, UNKNOWN as NOT_ESTIMATED
from smart_tire.analysis.figure import SOURCES
from smart_tire.analysis.html_report.content import report_of
from smart_tire.analysis.html_report.page import html_page
from smart_tire.analysis.offline import Analysis, analyze
from smart_tire.analysis.pipeline import bag_params, BagParams, EstimatorParams, INPUTS
from smart_tire.analysis.tables import date_text, FIRST_DATE_NS, value_of
from smart_tire.bags import Bag, check_inputs, TopicNames
from smart_tire.errors import BagError, SmartTireError
from smart_tire.findings import Level
from smart_tire.fleet.dataset import Dataset, estimate_tables, SCHEMA
from smart_tire.fleet.sources import (
    fingerprint, is_url, local_bag, path_of, Source, Wait)
from smart_tire.messages import find_topic
from smart_tire.paths import bag_name

REQUIRED = 'imu/data', 'wheel_states'
ESTIMATED, INCOMPLETE, CONTRADICTED, DIVERGED, NOTHING, UNREADABLE = (
    'estimated', 'incomplete', 'contradicted', 'diverged', 'nothing', 'unreadable')
# Columns of the table of drives, and their places in the trees of estimates and errors.
OF_ESTIMATES = {
    'distance': 'odom.distance_m', 'slip_left': 'wheel_slip.left.mean',
    'slip_right': 'wheel_slip.right.mean',
    'friction': 'ground_state.friction_coefficient.median',
    'friction_sigma': 'ground_state.friction_coefficient.median_sigma'}
OF_ERRORS = {
    'position_rms': 'pose.position_rms_m', 'position_end': 'pose.position_end_m',
    'yaw_rms': 'pose.yaw.rms', 'yaw_end': 'pose.yaw_end_rad', 'slip_rms': 'slip.rms',
    'friction_error': 'friction.median_relative_error'}
DIGEST = 8  # characters that distinguish bags of one name


@dataclass(frozen=True)
class AnalyzedDrive:
    """What became of a bag."""

    name: str
    row: dict[str, Any]  # of the table of drives
    robot: str = ''      # '' if unknown
    date: str = ''       # YYYY-MM-DD; '' if unknown
    done_before: bool = False


@dataclass(frozen=True)
class DriveJob:
    """How the bags of a fleet are analyzed; a call writes one to the data set in ``folder``."""

    folder: Path
    wait: Wait
    params: tuple[Path, ...] = ()  # instead of the parameters in the bags
    remap: tuple[str, ...] = ()
    robot: str = ''                # that all bags are of
    checks: bool = True
    reports: bool = False
    force: bool = False            # also what is done

    def __call__(self, source: Source) -> AnalyzedDrive:
        """
        Analyze a bag unless that is done; write its rows, and its report.

        Raises BagError or ParameterError if it cannot be read, OutputError if it cannot be
        written.
        """
        dataset, name = Dataset(self.folder), drive_name(source)
        key = self._key(source)
        if dataset.key_of(name) == key and not self.force:
            return AnalyzedDrive(name, {}, done_before=True)
        with local_bag(source, self.wait) as path:
            drive, estimates, report = self._analyzed(source, path)
        dataset.write(name, key, drive.robot, drive.date, drive.row, estimates, report)
        return drive

    def unreadable(self, source: Source, error: BaseException) -> AnalyzedDrive:
        """Write that a bag could not be read, unless the data set has estimates of it."""
        text = str(error) if isinstance(error, SmartTireError) else (
            f'{type(error).__name__}: {error}')
        dataset, drive = Dataset(self.folder), AnalyzedDrive(drive_name(source), {
            'bag': _place(source), 'status': UNREADABLE, 'error': text}, self.robot)
        if not dataset.key_of(drive.name):
            dataset.write(drive.name, '', drive.robot, '', drive.row, {})
        return drive

    def _key(self, source: Source) -> str:
        """Return the hash of all that the estimates of a bag depend on."""
        params = EstimatorParams.load(self.params).text if self.params else ''
        text = json.dumps([SCHEMA, smart_tire.__version__, fingerprint(source), params,
                           self.remap, self.robot, self.checks, self.reports])
        return sha256(text.encode()).hexdigest()

    def _analyzed(self, source: Source, path: Path) -> tuple[AnalyzedDrive, dict[str, Any], str]:
        """Return the drive, the tables of its estimates and its report."""
        names, drive = TopicNames.parse(self.remap), drive_name(source)
        with Bag(path, names) as bag:
            used = bag_params(bag, self.params)
            bag.joints = used.params.robot.joints
            check_inputs(bag, REQUIRED)
            names, robot, start_ns = bag.names, self._robot_of(bag), bag.span_ns[0]
        found = analyze(path, None, used.params, names=names, source=used, checks=self.checks)
        row = {**drive_row(drive, found, used), 'bag': _place(source), 'start_ns': start_ns}
        estimates, report = estimate_tables(drive, found.estimates), ''
        if self.reports and found.summary is not None:
            report = html_page(report_of(found, used, drive, [
                ('Recorded', date_text(start_ns)), ('Bag', _place(source)),
                ('Software', f'smart_tire {smart_tire.__version__}')]))
            row['report'] = Dataset.report(drive)
        return AnalyzedDrive(drive, row, robot, date_of(start_ns)), estimates, report

    def _robot_of(self, bag: Bag) -> str:
        """Return the robot, by the namespace of the topics; raise BagError if it is another."""
        space = namespace(bag.match(INPUTS).values())
        if self.robot and space and space != self.robot:
            raise BagError(f'{bag.path}: of robot {space}, expected {self.robot} (--robot)')
        return self.robot or space


def drive_row(drive: str, found: Analysis, used: BagParams) -> dict[str, Any]:
    """Return the columns of the table of drives that follow from an analysis."""
    contents, summary = found.contents, found.summary
    findings = {level: [one.text for one in contents.findings if one.level is level]
                for level in (Level.ERROR, Level.WARNING)}
    row: dict[str, Any] = {
        'status': CONTRADICTED if findings[Level.ERROR] else
        INCOMPLETE if contents.losses else ESTIMATED, 'duration': contents.duration_s,
        'errors': findings[Level.ERROR], 'warnings': findings[Level.WARNING],
        'parameters': used.origin}
    if summary is None:
        return {**row, 'status': NOTHING, 'error': '; '.join(contents.skipped)}
    if summary['diverged'] is not None:
        row.update(status=DIVERGED, error=summary['diverged'])
    filtered = found.result.filtered
    if len(filtered.reference):
        row['reference'] = SOURCES[filtered.name]
    _, _, errors = next(rows_of({drive: filtered}))
    estimates = {**NOT_ESTIMATED, **summary['estimates']}
    return row | {name: value_of(tree, key) for tree, keys in (
        (estimates, OF_ESTIMATES), (errors, OF_ERRORS)) for name, key in keys.items()}


def namespace(names: Iterable[str]) -> str:
    """Return the namespace of the first of ``names`` that is a standard topic; '' if none is."""
    for name in names:
        if (topic := find_topic(name)) is not None:
            return name.strip('/')[:-len(topic.name)].strip('/')
    return ''


def drive_name(source: Source) -> str:
    """Return the name of a drive: that of its bag, and a hash of where that is."""
    digest = sha256(_place(source).encode()).hexdigest()[:DIGEST]
    return f'{re.sub(r"[^A-Za-z0-9_.-]", "_", bag_name(path_of(source)))}-{digest}'


def _place(source: Source) -> str:
    return str(source) if is_url(source) else str(path_of(source).resolve())


def date_of(stamp_ns: int) -> str:
    """Return the date of a receive time in UTC; '' of simulated time, which is no date."""
    return '' if stamp_ns < FIRST_DATE_NS else str(np.datetime64(stamp_ns, 'ns').astype('M8[D]'))
