# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a muscle analysis, after Figs. 5 to 10 of the paper.

Lines differ in dashes and points in shape, so that they are distinguished in black and white.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpms_ros.axis import QUANTITIES
from rpms_ros.errors import ReportError
from rpms_ros.identification.analysis import (
    FieldAnalysis,
    MuscleAnalysis,
    SummationAnalysis,
    TwitchAnalysis,
)
from rpms_ros.identification.analysis.trains import TrainAnalysis, evenly
from rpms_ros.identification.analysis.twitch_fits import CONSTANT, PEAK
from rpms_ros.identification.analysis.twitches import LatencyTable
from rpms_ros.muscle import twitch
from rpms_ros.printable import counted

MEASURED = '#b0b0b0'
COLOURS = ('#0b4f7d', '#c65d00', '#3f7f2c', '#7b4fa3', '#a8234a', '#5f5f5f')
MARKERS = ('o', 's', '^', 'D', 'v', 'P')
DASHES = ('-', '--', ':', '-.', (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)))
_BY_INTENSITY = 'intensity [%], 0 if not recorded'
_FORCE = 'force [N]'
# More panels than this cannot be read on one page.
_MOST_TRAINS = 24


def draw_analysis(folder: Path, analysis: MuscleAnalysis, title: str = '') -> tuple[Path, ...]:
    """Write a figure for each kind of result; return the files.

    Parameters
    ----------
    folder : Path
        Existing folder.
    analysis : MuscleAnalysis
        What is drawn.
    title : str
        Name of the recording.

    Raises
    ------
    ReportError
        If a file cannot be written.
    """
    figures = {}
    if analysis.twitches:
        figures['twitches'] = draw_twitches(analysis.twitches, title)
    if analysis.summation:
        figures['trains'] = draw_trains(analysis.summation, title)
    if analysis.recruitment:
        figures['recruitment'] = draw_field(analysis.recruitment, title)
    for name, figure in figures.items():
        _label_forces(figure, analysis.unit)
        save_figure(figure, folder / f'{name}.png')
    return tuple(folder / f'{name}.png' for name in figures)


def draw_twitches(found: TwitchAnalysis, title: str = '') -> Figure:
    """Return latency and T_a by intensity, and E_min by peak (Tables 1 and 2, Fig. 5)."""
    figure = _figure(10.0, 7.0, title)
    (example, error), (latency, constant) = figure.subplots(2, 2)
    _draw_example(example, found)
    _draw_latency(latency, found.latency, 0)
    _draw_latency(latency, found.crossing_latency, 1)
    latency.set(xlabel=_BY_INTENSITY, ylabel='latency $T_l$ [ms]')
    # room above the bars, so that the legend hides none
    low, high = latency.get_ylim()
    latency.set_ylim(low, high + 0.2 * (high - low))
    latency.legend(fontsize=7, loc='upper center', ncols=2)
    values = 1e3 * found.fits.column(CONSTANT, found.choice.order)
    _draw_points(constant, 100 * np.nan_to_num(found.fits.intensity), values, 0)
    constant.axhline(1e3 * found.shared.time_constant, color='black', lw=1)
    constant.set_xlabel(_BY_INTENSITY)
    constant.set_ylabel(f'$T_a$ at order {found.choice.order} [ms]; line: shared')
    for index, order in enumerate(found.fits.orders):
        peaks = found.fits.column(PEAK, order)
        peaks = peaks * (100 / peaks.max())
        _draw_points(error, peaks, found.fits.least_error(order), index, f'order {order}')
    error.set_yscale('log')
    error.set(xlabel=r'$F_\max$, 100 for the largest [%]', ylabel=r'$E_\min$ (Eq. 3)')
    error.legend(fontsize=8)
    return figure


def _draw_example(axes: Axes, found: TwitchAnalysis) -> None:
    """Draw the strongest twitch with the fit of each order."""
    response = found.example
    index = int(np.argmax(found.fits.column(PEAK, found.choice.order)))
    lag, force = response.lag, np.where(response.usable, response.force, np.nan)
    axes.plot(1e3 * lag, force, color=MEASURED, lw=2.5, label='measured, without artifact')
    for place, order in enumerate(found.fits.orders):
        onset, constant, peak, base = found.fits.table[index, place, :4]
        fitted = base + peak * twitch(lag - onset, constant, order)
        _draw_line(axes, 1e3 * lag, fitted, place, f'order {order}')
    axes.set(xlabel='time after the pulse [ms]', ylabel=_FORCE)
    axes.legend(fontsize=8)


def _draw_latency(axes: Axes, table: LatencyTable, index: int) -> None:
    if not table.rows:
        return
    rows = np.array([(row.intensity, row.mean, row.spread) for row in table.rows])
    # side by side, so that both are visible
    percent = 100 * np.nan_to_num(rows[:, 0]) + (index - 0.5) * 1.2
    mean, spread = 1e3 * rows[:, 1], 1e3 * np.nan_to_num(rows[:, 2])
    name, colour = f'{table.method}, from {table.reference}', COLOURS[index]
    axes.errorbar(percent, mean, spread, fmt='none', color=colour, capsize=3)
    _draw_points(axes, percent, mean, index, name)


def _label_forces(figure: Figure, unit: str) -> None:
    for axes in figure.axes:
        if axes.get_ylabel() == _FORCE:
            axes.set_ylabel(f'{QUANTITIES[unit]} [{unit}]')


def draw_trains(
    found: SummationAnalysis, title: str = '', unit: str = 'N', figure: Figure | None = None
) -> Figure:
    """Return trains with their models, and the gains of their pulses (Figs. 6 to 8).

    Every train has a panel; of more than 24, so many are chosen evenly over numbers of
    pulses and rates, and the title says so.  An empty `figure` is drawn into, its size set.
    """
    ordered = sorted(found.trains, key=lambda train: (len(train.response.onset), train.rate_hz))
    picked = [ordered[place] for place in evenly(len(ordered), _MOST_TRAINS)]
    if len(picked) < len(ordered):
        chosen = f'{len(picked)} of {len(ordered)} trains, evenly over pulses and rates'
        title = f'{title}: {chosen}' if title else chosen
    columns = min(3 if len(picked) <= 12 else 4, len(picked))
    rows = -(-len(picked) // columns)
    figure = _figure(3.9 * columns + 4.0, 2.9 * rows + 0.6, title, figure)
    grid = figure.add_gridspec(rows, columns + 1, width_ratios=[1.0] * columns + [1.1])
    for index, train in enumerate(picked):
        axes = figure.add_subplot(grid[index // columns, index % columns])
        _draw_train(axes, train)
        if index == 0:
            axes.legend(fontsize=7)
    _draw_gains(figure.add_subplot(grid[:, columns]), found)
    _label_forces(figure, unit)
    return figure


def _draw_gains(axes: Axes, found: SummationAnalysis) -> None:
    """Draw the gains of all trains, with one kind of line for each number of pulses and rate."""
    kinds: dict[str, list[TrainAnalysis]] = {}
    for train in found.trains:
        kinds.setdefault(_name(train), []).append(train)
    for index, (name, alike) in enumerate(kinds.items()):
        kind = index % len(DASHES)
        for place, train in enumerate(alike):
            values = train.gains.gains / max(train.equal.gains[0], 1e-300)
            pulse = np.arange(1, len(values) + 1)
            label = None if place else f'{name}, {len(alike)} trains'
            _draw_line(axes, pulse, values, kind, label, marker=MARKERS[kind], mfc='white', ms=4)
    axes.axhline(1.0, color='black', lw=0.6)
    axes.set(xlabel='pulse', ylabel='gain, equal pulses = 1')
    axes.legend(fontsize=7)


def _draw_train(axes: Axes, train: TrainAnalysis) -> None:
    response = train.response
    force = np.where(response.usable, response.force, np.nan)
    axes.plot(response.lag, force, color=MEASURED, lw=2.5, label='measured')
    fits = []
    for name, fit, dashes, width, colour in (
        ('equal pulses', train.equal, '--', 1.3, 'black'),
        ('a gain a pulse', train.gains, ':', 1.6, COLOURS[1]),
        ('history law', train.law, '-', 0.9, COLOURS[0]),
    ):
        if fit is not None:
            axes.plot(response.lag, fit.modelled, ls=dashes, lw=width, color=colour, label=name)
            fits.append(f'{fit.fit:.1f}')
    below = np.full(len(response.onset), axes.get_ylim()[0])
    axes.plot(response.onset, below, '|', color='black', ms=6)
    unseen = ', law unseen' if train.held_out else ''
    axes.set_title(f'{_name(train)}{unseen}: {" / ".join(fits)} %', fontsize=8)
    # twelve time constants after its onset a twitch of order 3 or 4 is over
    end = response.onset[-1] + train.equal.latency + 12.0 * train.equal.time_constant
    axes.set_xlim(response.lag[0], min(end, response.lag[-1]))
    axes.locator_params(axis='x', nbins=5)
    axes.set(xlabel='time [s]', ylabel=_FORCE)


def _name(train: TrainAnalysis) -> str:
    return f'{counted(len(train.response.onset), "pulse")}, {train.rate_hz:.3g} Hz'


def draw_field(found: FieldAnalysis, title: str = '') -> Figure:
    """Return steady force by intensity at each rate, and by rate (Figs. 9 and 10)."""
    figure = _figure(8.0, 4.2, title)
    by_intensity, by_rate = figure.subplots(1, 2)
    rows = np.array([(point.rate_hz, point.intensity, point.force) for point in found.points])
    rates, levels, force = rows.T
    scale = found.maximum_force.value
    u = np.linspace(0.0, 1.0, 101)
    _draw_family(
        by_intensity, np.round(rates, 1), 100 * levels, force / scale,
        lambda rate: (100 * u, found.recruitment(u, rate)), '{:g} Hz',
    )  # fmt: skip
    by_intensity.set(xlabel='intensity [%]', ylabel=r'$\rho$, 1 at 100 % and 20 Hz')
    f = np.linspace(rates.min(), rates.max(), 101)
    _draw_family(
        by_rate, np.round(levels, 3), rates, force / scale,
        lambda level: (f, found.recruitment(level, f)), '{:.0%}',
    )  # fmt: skip
    by_rate.set(xlabel='repetition rate [Hz]', ylabel=r'$\rho$')
    by_rate.set_title(f'interval +-{found.worst_interval:.2%}', fontsize=9)
    return figure


def _draw_family(
    axes: Axes,
    member_of: np.ndarray,
    abscissa: np.ndarray,
    ordinate: np.ndarray,
    curve: Callable[[float], tuple[np.ndarray, np.ndarray]],
    label: str,
) -> None:
    """Draw points with the curve through them, one kind of line a member, evenly chosen."""
    distinct, count = np.unique(member_of, return_counts=True)
    # those that come three times or more, or all if none does
    frequent = distinct[count >= min(3, count.max())]
    for index, member in enumerate(frequent[evenly(len(frequent), len(DASHES))].tolist()):
        mine = member_of == member
        _draw_points(axes, abscissa[mine], ordinate[mine], index)
        _draw_line(axes, *curve(member), index, label.format(member))
    axes.legend(fontsize=7)


def _draw_points(
    axes: Axes, x: np.ndarray, y: np.ndarray, index: int, label: str | None = None
) -> None:
    """Draw points in the shape and colour of a number."""
    axes.plot(x, y, MARKERS[index], color=COLOURS[index], mfc='none', ms=4, label=label)


def _draw_line(
    axes: Axes, x: np.ndarray, y: np.ndarray, index: int, label: str | None, **more: Any
) -> None:
    """Draw a line in the dashes and colour of a number."""
    axes.plot(x, y, ls=DASHES[index], color=COLOURS[index], lw=1.1, label=label, **more)


def _figure(width: float, height: float, title: str, figure: Figure | None = None) -> Figure:
    figure = figure or Figure(layout='constrained', dpi=130)
    figure.set_size_inches(width, height)
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def save_figure(figure: Figure, *paths: Path) -> None:
    """Write a figure; the ending of each path names a format.

    Raises
    ------
    ReportError
        If a file cannot be written.
    """
    for path in paths:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path)
        except (OSError, ValueError) as error:
            raise ReportError(f'expected a figure file to write, got {path}: {error}') from error
