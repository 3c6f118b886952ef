"""Sections on what was recorded: faults, schedule and energy, facts, reporting checklist."""

from collections.abc import Callable
from datetime import UTC
from datetime import datetime
from html import escape
from typing import Any

from rpms_ros.pulses import NANOSECONDS_PER_SECOND
from rpms_ros.report.session.excitation import TRAIN_GAP
from rpms_ros.report.session.markup import figures
from rpms_ros.report.session.markup import number
from rpms_ros.report.session.markup import paragraph
from rpms_ros.report.session.markup import table

Figure = Callable[[str, str], str]
Document = dict[str, Any]
_PARTS = {'subject': 'Subject', 'method': 'Method', 'protocol': 'Stimulation protocol'}
# A note longer than this is data for programs.
_LONGEST_NOTE = 160


def faults(document: Document, _figure: Figure) -> str:
    """Return what went wrong, how often, and what it means."""
    driver = document['driver']
    rows = [(fault['name'], str(fault['count']), fault['meaning']) for fault in document['faults']]
    if driver:
        rows += [(name, str(n), 'the stimulator driver') for name, n in driver['faults'].items()]
    if not rows:
        return paragraph('None were counted.')
    return table(('fault', 'count', 'meaning'), rows)


def schedule(document: Document, figure: Figure) -> str:
    """Return what was done to the muscle and the energy that it took."""
    plan, energy = document['schedule'], document['energy']
    rate, intensity = plan['rate_hz'], plan['intensity']
    rows = [
        ('pulses', str(plan['pulses'])),
        ('trains', f'{plan["trains"]}; a pause over {TRAIN_GAP:g} s ends one'),
        ('time within trains', number(plan['stimulated_s'], 's')),
        (
            'repetition rate',
            rate
            and f'{rate["median"]:.4g} Hz (median), {rate["lowest"]:.4g} to '
            f'{rate["highest"]:.4g} Hz',
        ),
        (
            'intensity',
            intensity
            and f'{intensity["lowest"]:.3g} to {intensity["highest"]:.3g} of the '
            f'maximum, mean {intensity["mean"]:.3g}',
        ),
        ('pulse width', ', '.join(f'{1e6 * w:.4g} µs' for w in plan['pulse_width_s'])),
        ('energy', f'{energy["full_intensity_pulses"]:.5g} pulses at full intensity'),
        *_device(energy['device']),
        *_driver(document['driver']),
    ]
    drawn = figure('schedule', 'Intensity of the pulses and cumulated energy over time')
    return figures((drawn,)) + table(('quantity', 'value'), rows)


def _device(device: dict[str, Any] | None) -> list[tuple[str, str]]:
    if device is None:
        return []
    celsius = device['highest_temperature_celsius']
    return [
        (f'energy on {device["name"]}', number(device['energy_j'], 'J')),
        (
            f'highest mean power over {device["window_s"]:g} s',
            number(device['highest_power_w'], 'W'),
        ),
        *([('coil, modelled', f'{celsius:.1f} Celsius at most')] if celsius is not None else []),
    ]


def _driver(driver: dict[str, Any] | None) -> list[tuple[str, str]]:
    if driver is None:
        return []
    return [
        ('driver: schedule', driver['schedule'] or 'not named'),
        (
            'driver: pulses since its device was opened',
            f'{driver["pulses_delivered"]} delivered, {driver["pulses_dropped"]} dropped',
        ),
        ('driver: energy into the coil', number(driver['coil_energy_j'], 'J')),
        (
            'driver: highest coil temperature',
            number(driver['highest_temperature_celsius'], 'Celsius'),
        ),
        ('driver: largest lateness', number(_scaled(driver['lateness_max_s'], 1e3), 'ms')),
    ]


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def facts(document: Document, _figure: Figure) -> str:
    """Return what the recording says about itself."""
    session = document['session']
    start = datetime.fromtimestamp(session['start_ns'] // NANOSECONDS_PER_SECOND, UTC)
    rows = [
        ('recording', f'{session["recording"]} ({session["storage"]})'),
        ('first force sample', f'{start:%Y-%m-%d %H:%M:%S} UTC by its stamp'),
        ('duration', number(session['duration_s'], 's')),
        (
            'force',
            f'{session["samples"]} samples at {number(session["sampling_rate_hz"], "Hz")}',
        ),
        ('estimates in the recording', str(session['recorded_estimates'])),
    ]
    rows += [
        (f'frame of {name}', ', '.join(frames) or 'none')
        for name, frames in session['frame_ids'].items()
    ]
    rows += [(f'note: {name}', _short(text)) for name, text in session['notes'].items()]
    topics = [
        (topic['name'], topic['type'], str(topic['messages'])) for topic in session['topics']
    ]
    return table(('fact', 'value'), rows) + table(('topic', 'type', 'messages'), topics)


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_NOTE else f'{text[:_LONGEST_NOTE]} …'


def checklist(document: Document, _figure: Figure) -> str:
    """Return the fields of the reporting checklist, filled as far as they are known."""
    listed = document['checklist']
    items, totals = listed['items'], listed['items_of_the_consensus']
    known = sum(item['value'] is not None for item in items)
    body = paragraph(
        f'{known} of the {len(items)} items below are known. The consensus has '
        f'{sum(totals.values())} items ({totals["subject"]} on the subject, {totals["method"]} on '
        f'the method, {totals["protocol"]} on the protocol); those not below have to be taken '
        'from the publication.'
    )
    for part, heading in _PARTS.items():
        rows = [
            (item['label'], item['value'] or 'to be stated', item['origin'] or '')
            for item in items
            if item['part'] == part
        ]
        count = f'{len(rows)} of {totals[part]} items'
        body += f'<h3>{heading} <small>{count}</small></h3>'
        body += table(('item', 'value', 'known from'), rows)
    return f'{body}<p class="source">Source: {escape(listed["source"])}</p>'
