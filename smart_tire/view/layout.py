# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arrangement of the views, sent to the viewer with the data."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from smart_tire.analysis.figure import SIGMAS
from smart_tire.samples import WHEELS
from smart_tire.view.writer import REFERENCES, TIMELINE

LIVE_SPAN = 30.0  # s, shown by the plots of live data
BOUNDS = f'± {SIGMAS:g} σ'
SLIP_RANGE = (-1.0, 1.0)  # of the slip ratio; its bounds are wider at standstill
STATE_RANGE = (-0.5, 4.5)  # of path_progress
WIDE = 65.0       # N, half the size of the view of the friction circles
CONTACT_WIDTH, CONTACT_HEIGHT = 75.0, 55.0  # half the size of the view of a crossing


class ViewLayout:
    """
    Views of a recording or, with ``live``, of the latest ``LIVE_SPAN`` seconds.

    ``films`` are the wheels with films; with ``camera`` there is a page of its images. Titles
    contain the units, which rerun does not show at its axes.
    """

    def __init__(self, films: Sequence[str], *, live: bool, camera: bool = False) -> None:
        self._films, self._live, self._camera = films, live, camera

    def blueprint(self) -> rrb.Blueprint:
        """Return the whole arrangement."""
        return rrb.Blueprint(
            rrb.Tabs(self._overview(), self._contact(), self._motion(), self._ground(),
                     self._links(), self._sensors(), *[self._images()] * self._camera,
                     active_tab=0),
            rrb.BlueprintPanel(state='collapsed'), rrb.SelectionPanel(state='collapsed'),
            rrb.TimePanel(state='collapsed', timeline=TIMELINE, play_state='following'),
            auto_layout=False, auto_views=False)

    def _overview(self) -> rrb.Container:
        front = self._films[:2]
        return rrb.Grid(
            *(self._slip(wheel) for wheel in WHEELS[:2]), self._friction(legend=False),
            self._path(), *(self._slip(wheel) for wheel in WHEELS[2:]),
            self._stiffness(legend=False), self._forces(),
            *(self._crossing(wheel) for wheel in front),
            *([self._plot('Velocity v_x: cmd_vel, estimate [m/s]', 'body/velocity')]
              * (len(front) < 2)),
            self._plot('Wheels: set points (steps), speeds [rad/s]', 'wheels', contents=(
                '/wheels/speed/**', '/wheels/set_point/**'), legend=False),
            self._counts(), grid_columns=4, name='Overview')

    def _contact(self) -> rrb.Container:
        rows = [rrb.Horizontal(
            self._plot(f'Film voltages, {wheel} [V]', f'films/{wheel}'), self._crossing(wheel),
            rrb.TextDocumentView(origin=f'contact/{wheel}/result',
                                 name=f'Latest crossing, {wheel}'),
            column_shares=[3, 2, 1.5]) for wheel in self._films]
        return rrb.Vertical(*rows, name='Contact')

    def _motion(self) -> rrb.Container:
        return rrb.Grid(
            self._plot(f'Velocity v_x [m/s], {BOUNDS}', 'body/velocity'),
            self._plot(f'Yaw rate [rad/s], {BOUNDS}', 'body/yaw_rate'),
            self._plot('Wheel speeds, measured [rad/s]', 'wheels/speed'),
            self._plot('wheel_commands: set points [rad/s]', 'wheels/set_point'),
            self._plot('motor_commands: duties [-]', 'wheels/duty'),
            self._plot('Motor torques at the wheels [N m]', 'wheels/torque'),
            self._plot('path_progress: cross-track error [m]', 'progress/cross_track_error'),
            self._plot('path_progress: state (0 idle, 1 following, 2 arrived, 3 stopped, '
                       '4 refused)', 'progress/state', bounds=STATE_RANGE),
            grid_columns=2, name='Commands and motion')

    def _ground(self) -> rrb.Container:
        return rrb.Grid(
            self._friction(), self._stiffness(),
            self._plot('Longitudinal forces F_x [N]: brush model (lines), crossings (points)',
                       'traction'),
            self._plot('Share of the friction used, |F| / (mu F_z) [-]', 'friction_used'),
            self._plot(f'Rolling resistance over load [-], {BOUNDS}', 'rolling_resistance'),
            self._plot('Center of rotation in base_link [m]', 'body/icr'),
            grid_columns=2, name='Ground and forces')

    def _links(self) -> rrb.Container:
        return rrb.Vertical(
            rrb.Horizontal(self._counts(), self._plot('Lost, bad and late, by node',
                                                      'links/counts')),
            rrb.Horizontal(
                self._plot('Ages of the latest messages, /diagnostics [s]', 'links/ages'),
                self._plot('Delay of this viewer: reception to viewer [s]', 'links/delay')),
            rrb.TextLogView(origin='links/events', name='Events'), name='Links')

    def _sensors(self) -> rrb.Container:
        return rrb.Vertical(
            self._plot('Specific force of the IMU [m/s²]', 'imu/acceleration'),
            self._plot('Angular rate of the IMU [rad/s]', 'imu/rate'),
            self._plot('Batteries of the sensor nodes [V]', 'battery'), name='Sensors')

    def _images(self) -> rrb.Container:
        return rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial2DView(origin='camera', name='Image of the overhead camera, tags'),
                self._path()),
            rrb.Horizontal(*map(self._slip, WHEELS[:2])), row_shares=[2, 1], name='Camera')

    def _slip(self, wheel: str) -> rrb.View:
        return self._plot(f'Slip, {wheel} [-], {BOUNDS}; truth (gray), camera (yellow)',
                          f'slip/{wheel}', bounds=SLIP_RANGE, legend=False)

    def _friction(self, *, legend: bool = True) -> rrb.View:
        return self._plot(f'Friction mu [-]: fused {BOUNDS} (lines), single (points)', 'friction',
                          bounds=(0.0, 1.2), legend=legend)

    def _stiffness(self, *, legend: bool = True) -> rrb.View:
        return self._plot(f'Stiffness C_x of the ground [N], {BOUNDS}', 'stiffness', legend=legend)

    def _counts(self) -> rrb.View:
        return self._plot('Lost, bad and late, all nodes [-]', 'links/total')

    def _path(self) -> rrb.View:
        history = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(
            TIMELINE, start=rrb.TimeRangeBoundary.infinite(),
            end=rrb.TimeRangeBoundary.cursor_relative())])
        return rrb.Spatial2DView(
            origin='path',
            name='Path [m]: estimate (blue), truth (gray), camera (yellow), wanted (red)',
            overrides=dict.fromkeys(
                ('path/estimate', *(f'path/{name}' for name in REFERENCES)), history))

    def _forces(self) -> rrb.View:
        return rrb.Spatial2DView(
            origin='forces', name='Friction circles and forces [N], forward is up',
            visual_bounds=rrb.VisualBounds2D(x_range=(-WIDE, WIDE), y_range=(-WIDE, WIDE)))

    @staticmethod
    def _crossing(wheel: str) -> rrb.View:
        return rrb.Spatial2DView(
            origin=f'contact/{wheel}', visual_bounds=rrb.VisualBounds2D(
                x_range=(-CONTACT_WIDTH, CONTACT_WIDTH),
                y_range=(-CONTACT_HEIGHT, CONTACT_HEIGHT)),
            name=f'Crossing, {wheel}: V over mm, samples and model')

    def _plot(self, name: str, origin: str, *, contents: Sequence[str] = ('$origin/**',),
              bounds: tuple[float, float] | None = None, legend: bool = True) -> rrb.View:
        span = [rrb.VisibleTimeRange(
            TIMELINE, start=rrb.TimeRangeBoundary.cursor_relative(seconds=-LIVE_SPAN),
            end=rrb.TimeRangeBoundary.cursor_relative())] if self._live else None
        return rrb.TimeSeriesView(
            origin=origin, name=name, time_ranges=span, contents=list(contents),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
            axis_y=None if bounds is None else rrb.ScalarAxis(range=bounds))
