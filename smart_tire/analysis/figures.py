"""What a run shows: series to curves, curves to PNG files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.friction_metrics import column, kind_of, telling
from smart_tire.analysis.metrics import aligned, SIDES, Spans
from smart_tire.analysis.series import at, seconds, Series, Stamps
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, WHEELS

MARGIN = 0.2         # of the range of the slips, for their bands
MIN_SLIP = 0.1       # margin where the slips hardly differ
MAX_FRICTION = 1.2   # bars that end above it say only that they are long
CONTACT_REACH = 1.5  # patch lengths of travel drawn before and after a passage
FILTERED = 'filtered'
PATH_COLORS = {FILTERED: drawing.ORANGE}  # beside what is smoothed

Shown = Mapping[str, Series]  # way of estimating -> its estimates; the filter's come first


def write_figures(directory: Path, inputs: Series, estimates: Series, truth: Series,
                  robot: RobotParams, spans: Spans | None = None,
                  smoothed: Series | None = None) -> list[Path]:
    """
    Draw slip, path, friction and a contact, as far as there is any, and return the files.

    ``truth`` may be empty; ``spans`` gives each of its stretches a panel of slip; what is
    ``smoothed`` is drawn beside the estimates of the filter.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for name, figure in _figures(inputs, shown(estimates, smoothed), truth, robot, spans):
        written.append(directory / f'{name}.png')
        figure.savefig(written[-1], dpi=drawing.DOTS_PER_INCH)
    return written


def shown(estimates: Series, smoothed: Series | None = None) -> Shown:
    """Return the names by which estimates are told apart, and them."""
    return {'estimate': estimates} if smoothed is None else {
        FILTERED: estimates, 'smoothed': smoothed}


def _figures(inputs: Series, ways: Shown, truth: Series, robot: RobotParams,
             spans: Spans | None) -> Iterator[tuple[str, Figure]]:
    estimates = next(iter(ways.values()))
    slips, poses = estimates.slips().stamp_ns, estimates.poses().stamp_ns
    stamps = np.concatenate([slips, poses, _stamps(estimates.passages)])
    origin = int(stamps.min(initial=np.iinfo(np.int64).max))
    if len(slips):
        yield 'slip', slip_figure(ways, truth, origin, spans)
    if len(poses):
        yield 'path', path_figure(ways, truth)
    if estimates.passages:
        yield 'friction', friction_figure(ways, truth, origin)
    for passage in typical_passages(estimates.passages):
        contact = contact_of(passage, inputs, robot)
        if contact is not None:
            yield 'contact', contact_figure(contact)
            return


def slip_figure(ways: Shown, truth: Series, origin_ns: int, spans: Spans | None = None) -> Figure:
    """Return the slips of both sides over time, with panels for each way and for each span."""
    curves = {way: slip_curves(series, truth, origin_ns) for way, series in ways.items()}
    panels = {_title(ways, way, name): (own, name)
              for name in spans or [''] for way, own in curves.items()}
    names, columns = list(panels), 2 if spans else 1
    rows = [names[i:i + columns] for i in range(0, len(names), columns)]
    rows[-1] += ['.'] * (len(rows[0]) - len(rows[-1]))
    figure, axes = drawing.new_figure(rows, height=1.2 + 2.8 * len(rows), share_x=not spans,
                                    share_y=True)
    for title, (own, name) in panels.items():
        drawing.draw_slip(axes[title], own)
        axes[title].set(title=title)
        if spans:
            edges = [(edge - origin_ns) / NS_PER_S for span in spans[name] for edge in span]
            axes[title].set(xlim=(min(edges), max(edges)))
    axes[names[0]].set_ylim(*_slip_limits([curve for own in curves.values() for curve in own]))
    drawing.finish(figure, axes)
    return figure


def _title(ways: Shown, way: str, name: str) -> str:
    """Return the title of a panel; the only way needs no name."""
    return ', '.join(word for word in (name, way if len(ways) > 1 else '') if word)


def slip_curves(estimates: Series, truth: Series, origin_ns: int) -> list[drawing.SlipCurve]:
    """Return the slip of each side: the mean of its wheels."""
    own, true = estimates.slips(), truth.slips()
    return [drawing.SlipCurve(
        side, seconds(own.stamp_ns, origin_ns), own.ratio[:, wheels].mean(axis=1),
        own.sigma[:, wheels].mean(axis=1), seconds(true.stamp_ns, origin_ns),
        true.ratio[:, wheels].mean(axis=1)) for side, wheels in SIDES.items()]


def _slip_limits(curves: Sequence[drawing.SlipCurve]) -> tuple[float, float]:
    slips = np.concatenate([np.append(curve.slip, curve.true_slip) for curve in curves])
    slips = slips[np.isfinite(slips)]
    # Single spikes, of wheels that start to turn, must not set the scale.
    low, high = np.percentile(slips, (1.0, 99.0)) if len(slips) else (0.0, 0.0)
    margin = max(MARGIN * (high - low), MIN_SLIP)
    return max(-1.05, low - margin), min(1.05, high + margin)


def path_figure(ways: Shown, truth: Series) -> Figure:
    """Return the path, and with a truth the errors of position and heading over time."""
    paths = [drawing.Path(way, series.poses().pose[:, :2], PATH_COLORS.get(way, drawing.BLUE))
             for way, series in ways.items()]
    _, true, _ = aligned(truth.poses(), next(iter(ways.values())).poses())
    if not len(true):
        figure, axes = drawing.new_figure([['path']], width=6.0, height=5.5)
        drawing.draw_path(axes['path'], paths, None)
    else:
        figure, axes = drawing.new_figure([['path', 'position'], ['path', 'heading']], width=10.0,
                                        height=5.5)
        drawing.draw_path(axes['path'], paths, true[:, :2])
        for path, series in zip(paths, ways.values()):
            _draw_errors(axes, path, series, truth)
        axes['position'].set_ylim(bottom=0.0)
        axes['position'].legend(frameon=False)
    axes['path'].legend(frameon=False)
    return figure


def _draw_errors(axes: dict[str, Axes], path: drawing.Path, estimates: Series,
                 truth: Series) -> None:
    poses = estimates.poses()
    guess, true, stamps = aligned(truth.poses(), poses)
    time, error = seconds(stamps, int(poses.stamp_ns[0])), guess - true
    covariance = at(stamps, poses.stamp_ns, poses.pose_covariance)
    longest = np.sqrt(np.linalg.eigvalsh(covariance[:, :2, :2])[:, -1])
    drawing.draw_error(axes['position'], time, np.linalg.norm(error[:, :2], axis=1), longest,
                     'position error [m]', path)
    drawing.draw_error(axes['heading'], time, error[:, 2], np.sqrt(covariance[:, 2, 2]),
                     'heading error [rad]', path)


def friction_figure(ways: Shown, truth: Series, origin_ns: int) -> Figure:
    """Return friction per revolution, with panels for each instrumented wheel and each way."""
    wheels = [wheel for wheel in WHEELS
              if any(p.wheel == wheel for series in ways.values() for p in series.passages)]
    rows = [[_title(ways, way, wheel.replace('_', ' ')) for way in ways] for wheel in wheels]
    figure, axes = drawing.new_figure(rows, height=1.2 + 2.6 * len(wheels), share_x=True,
                                    share_y=True)
    for wheel, titles in zip(wheels, rows):
        for title, series in zip(titles, ways.values()):
            drawing.draw_friction(axes[title], friction_curve(wheel, series, truth, origin_ns))
            axes[title].set(title=title)
    axes[rows[0][0]].set_ylim(0.0, MAX_FRICTION)
    drawing.finish(figure, axes)
    return figure


def friction_curve(wheel: str, estimates: Series, truth: Series,
                   origin_ns: int) -> drawing.FrictionCurve:
    """Return the friction of ``wheel``; revolutions that tell nothing by themselves are NaN."""
    own, true = _of_wheel(estimates.passages, wheel), _of_wheel(truth.passages, wheel)
    single = column(own, 'friction_coefficient_single')
    sigma = column(own, 'friction_coefficient_single', sigmas=True)
    single[~telling(single, sigma)] = np.nan
    return drawing.FrictionCurve(
        wheel, seconds(_stamps(own), origin_ns), single, sigma,
        column(own, 'friction_coefficient'),
        column(own, 'friction_coefficient', sigmas=True),
        seconds(_stamps(true), origin_ns), column(true, 'friction_coefficient'))


def _of_wheel(passages: Sequence[Friction], wheel: str) -> list[Friction]:
    return sorted((p for p in passages if p.wheel == wheel), key=lambda p: p.stamp_ns)


def _stamps(passages: Sequence[Friction]) -> Stamps:
    return np.array([passage.stamp_ns for passage in passages], np.int64)


def typical_passages(passages: Sequence[Friction]) -> list[Friction]:
    """Return the passages that show most first: traction in the order of its median slip."""
    pulling = [p for p in passages if kind_of(p) == 'traction'] or [
        p for p in passages if np.isfinite(p.slip.value)]
    if not pulling:
        return []
    slips = column(pulling, 'slip')
    return [pulling[i] for i in np.argsort(np.abs(slips - np.median(slips)))]


def contact_of(passage: Friction, inputs: Series, robot: RobotParams) -> drawing.Contact | None:
    """Return the voltages around ``passage``; None where samples or the wheel speed miss."""
    speeds_ns, speeds = inputs.speeds()
    stamp = np.array([passage.stamp_ns])
    omega = at(stamp, speeds_ns, speeds)[0, WHEELS.index(passage.wheel)]
    if passage.wheel not in inputs.film_wheels() or not abs(omega) > 0.0:
        return None
    speed = robot.wheel_radius * omega
    reach = CONTACT_REACH * robot.tire.contact_length / abs(speed)
    stamps, volts = inputs.films(passage.wheel)
    time = seconds(stamps, passage.stamp_ns)
    near = np.abs(time) <= reach
    if near.sum() < 0.9 * 2.0 * reach * robot.film.sample_rate:
        return None  # a lost batch: the waveform would have a hole
    return drawing.Contact(passage.wheel, 1e3 * time[near], volts[near],
                         _inside(robot, speed, volts.shape[1]))


def _inside(robot: RobotParams, speed: float, films: int) -> list[tuple[float, float]]:
    """Return when [ms] any part of each film is in the patch, rolling at ``speed`` [m/s]."""
    half = 0.5 * (robot.tire.contact_length + robot.film.length) / abs(speed)
    # Film 1 leads when rolling forward: its middle passes half their extent before the stamp.
    places = [robot.film.places[film] for film in robot.film_groups[0][:films]]
    middles = [(place - 0.5 * (places[0] + places[-1])) / speed for place in places]
    return [(1e3 * (middle - half), 1e3 * (middle + half)) for middle in middles]


def contact_figure(contact: drawing.Contact) -> Figure:
    """Return the voltages of one contact."""
    figure, axes = drawing.new_figure([['contact']])
    drawing.draw_contact(axes['contact'], contact)
    drawing.finish(figure, axes)
    return figure
