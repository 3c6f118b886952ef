"""The sections of the page: each takes the document and a maker of figures, and returns HTML."""

from collections.abc import Callable
from typing import Any

from rpms_ros.report.session.markup import UNKNOWN
from rpms_ros.report.session.markup import definition
from rpms_ros.report.session.markup import figures
from rpms_ros.report.session.markup import number
from rpms_ros.report.session.markup import pair
from rpms_ros.report.session.markup import paragraph
from rpms_ros.report.session.markup import percent
from rpms_ros.report.session.markup import table
from rpms_ros.report.session.records import checklist
from rpms_ros.report.session.records import facts
from rpms_ros.report.session.records import faults
from rpms_ros.report.session.records import schedule

Figure = Callable[[str, str], str]
Document = dict[str, Any]
_EXCITATION_NAMES = ('not informed by the data', 'informed', 'converged')


def summary(document: Document, _figure: Figure) -> str:
    """Return the numbers that matter most, and what to beware of."""
    result, held_out, residuals = (document[key] for key in ('result', 'held_out', 'residuals'))
    curve = result['curve']
    rows = [
        ('Output error after settling, before learning', number(result['output_error_n'], 'N')),
        ('The same, share of the force range', percent(result['output_error_of_range'])),
        (
            'Error on the held-out part',
            percent(held_out and held_out['relative_error']),
        ),
        (
            f'Steady force at full intensity, {result["rate_hz"]:g} Hz',
            number(curve and curve['force'][-1], 'N'),
        ),
        ('Peak of one twitch', number(document['twitch']['peak_force'], 'N')),
        ('Residual, root mean square', number(residuals and residuals['root_mean_square'], 'N')),
        ('Faults counted', str(sum(fault['count'] for fault in document['faults']))),
    ]
    notes = ''.join(paragraph(remark, 'remark') for remark in document['remarks'])
    return definition(rows, 'tiles') + notes


def recruitment(document: Document, figure: Figure) -> str:
    """Return the recruitment curve and its parameters."""
    result, intervals = document['result'], document['intervals']
    drawn = figures((figure('recruitment', 'Recruitment curve: steady force over intensity'),))
    if result['recruitment'] is None:
        return drawn + paragraph('The pulses have one intensity: there is no curve to show.')
    values = result['recruitment'].items()
    if intervals is None:
        head: tuple[str, ...] = ('parameter', 'value')
        rows: list[tuple[str, ...]] = [(name, number(value)) for name, value in values]
        text = paragraph(f'The estimator {result["estimator"]} states no intervals.')
        return pair(drawn, text + table(head, rows))
    covariance, states = intervals['nonlinear_covariance'], intervals['nonlinear_excitation']
    head = ('parameter', 'value', 'deviation', 'what the data say')
    rows = [
        (
            name,
            number(value),
            number(covariance[index][index] ** 0.5 if covariance else None),
            _EXCITATION_NAMES[states[index]] if states else UNKNOWN,
        )
        for index, (name, value) in enumerate(values)
    ]
    return pair(drawn, table(head, rows))


def response(document: Document, figure: Figure) -> str:
    """Return the impulse response and the physiology read off it."""
    twitch = document['twitch']
    relaxation = twitch['half_relaxation_s']
    rows = [
        ('peak force', number(twitch['peak_force'], 'N')),
        ('time to peak', number(1e3 * twitch['time_to_peak_s'], 'ms')),
        (
            'half relaxation after the peak',
            number(None if relaxation is None else 1e3 * relaxation, 'ms'),
        ),
    ]
    text = table(('read off the curve', 'value'), rows)
    stated = [
        (item['name'], number(item['value']), _interval(item)) for item in document['physiology']
    ]
    if stated:
        text += table(('stated by the estimator', 'value', 'interval'), stated)
    else:
        name = document['result']['estimator']
        text += paragraph(f'The estimator {name} states no physiology.')
    return pair(figures((figure('response', 'Response to one pulse: force over time'),)), text)


def parameters(_document: Document, figure: Figure) -> str:
    """Return the paths of the parameters."""
    return figures((figure('parameters', 'Nonlinear parameters over time'),))


def force(_document: Document, figure: Figure) -> str:
    """Return the force with its viewer; without a script the figure stays."""
    still = figure('force', 'Measured and modelled force, and their difference, at the end')
    return (
        '<div id="viewer" hidden>'
        '<div class="tools" role="toolbar" aria-label="What is shown of the force">'
        '<span id="ranges"></span>'
        '<button type="button" data-zoom="0.5" aria-label="zoom in">+</button>'
        '<button type="button" data-zoom="2" aria-label="zoom out">&minus;</button>'
        '<button type="button" data-move="-0.5" aria-label="earlier">&larr;</button>'
        '<button type="button" data-move="0.5" aria-label="later">&rarr;</button>'
        '<output id="shown" aria-live="polite"></output></div>'
        '<canvas id="force-canvas" tabindex="0" role="img" aria-label="Measured and modelled '
        'force over time; arrow keys move, plus and minus zoom, 0 shows everything"></canvas>'
        '<p class="hint">Grey, thick: measured. Black, thin: modelled, predicted before it was '
        'measured. Below: measured minus modelled. Wheel zooms, dragging moves.</p></div>'
        f'<div id="still">{figures((still,))}</div>'
    )


def residuals(document: Document, figure: Figure) -> str:
    """Return whiteness and cross-correlation of the residual."""
    found = document['residuals']
    if found is None:
        return paragraph('The residual could not be analysed; see the remarks above.')
    drawn = figure('residuals', 'Autocorrelation of the residual; correlation with the pulses')
    p_value = found['ljung_box_p']
    white = found['ljung_box_p'] >= 0.05 and found['autocorrelation_outside'] <= 0.1
    shown_p = 'below 1e-12' if p_value < 1e-12 else f'{p_value:.3g}'
    rows = [
        ('residuals', f'{found["samples"]}, the last {percent(found["share_of_session"])}'),
        ('root mean square', number(found['root_mean_square'], 'N')),
        ('mean', number(found['mean'], 'N')),
        ('lags outside the band of white noise', percent(found['autocorrelation_outside'])),
        (
            f'Ljung-Box over {found["ljung_box_lags"]} lags',
            f'Q = {found["ljung_box"]:.5g}, p {"" if p_value < 1e-12 else "= "}{shown_p}',
        ),
        (
            'lags after a pulse outside the band of independence',
            percent(found['cross_correlation_outside'])
            if found['cross_correlation']
            else 'no pulses',
        ),
    ]
    verdict = (
        'The residual is white as far as this test can tell.'
        if white
        else 'The residual is not white: something is left that the model does not hold.'
    )
    return paragraph(verdict) + figures((drawn,)) + table(('quantity', 'value'), rows)


def held_out(document: Document, figure: Figure) -> str:
    """Return the fit on data that were not learnt from."""
    fit = document['held_out']
    if fit is None:
        return paragraph('Nothing could be held out; see the remarks above.')
    rows = [
        ('learnt from', number(fit['learnt_s'], 's')),
        ('held out', f'{number(fit["held_out_s"], "s")}, {fit["samples"]} samples'),
        ('relative error (L2)', percent(fit['relative_error'])),
        ('explained variance', percent(fit['explained_variance'])),
        ('fit, 1 - |e| / |y - mean|', f'{fit["fit_percent"]:.4g} %'),
    ]
    text = (
        'A fresh estimator learns from the first part only; the rest is predicted with what it '
        'knows by then.'
    )
    drawn = figure('held_out', 'Measured and modelled force after learning stopped')
    return paragraph(text) + figures((drawn,)) + table(('quantity', 'value'), rows)


def _interval(item: dict[str, Any]) -> str:
    if item['lower'] is None or item['upper'] is None:
        return UNKNOWN
    return f'{item["lower"]:.4g} to {item["upper"]:.4g}'


SECTIONS: tuple[tuple[str, str, Callable[[Document, Figure], str]], ...] = (
    ('summary', 'Summary', summary),
    ('recruitment', 'Recruitment', recruitment),
    ('response', 'Impulse response and physiology', response),
    ('parameters', 'Parameter paths', parameters),
    ('force', 'Force, measured and modelled', force),
    ('residuals', 'Residuals', residuals),
    ('held-out', 'Held-out fit', held_out),
    ('faults', 'Faults', faults),
    ('schedule', 'Schedule and energy', schedule),
    ('session', 'Session', facts),
    ('checklist', 'rPMS reporting checklist', checklist),
)
"""Id, heading and writer of each section, in the order of the page."""
