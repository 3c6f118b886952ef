# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of laboratories: what is accepted, what is guessed, and what is refused in which words.

Some have something odd or damaged: they are read, or refused at once in one line.
"""

import sys
import zipfile

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from rpms_ros.errors import RecordingError
from rpms_ros.recording.importing import Ambiguous, ImportOptions, import_file
from rpms_ros.recording.importing.whole_file import read_signals

openpyxl = pytest.importorskip('openpyxl')

COUNT = 200
TIME = np.arange(COUNT) / 1000.0
FORCE = np.round(2.0 + np.sin(TIME * 30.0), 4)
GATE = np.where(np.arange(COUNT) % 50 < 3, 5.0, 0.0)
GATE[:3] = 0.0
ONSETS = [50, 100, 150]


def imported(path, **given):
    found = import_file(path, ImportOptions(**given))
    return found.pulses, found.forces


def expect_the_session(pulses, forces, scale=1.0, late_s=0.0):
    np.testing.assert_allclose(forces.force, scale * FORCE, rtol=1e-6)
    start = forces.stamp_ns[0]
    np.testing.assert_allclose(forces.stamp_ns - start, 1e9 * TIME, atol=1.0)
    assert start == pytest.approx(1e9 * late_s, abs=1.0)
    assert (pulses.onset_ns - start).tolist() == [1_000_000 * place for place in ONSETS]


def rows(separator, comma=False, time=1.0):
    lines = [
        separator.join((f'{time * t:.6g}', f'{f:.4f}', f'{g:.1f}'))
        for t, f, g in zip(TIME, FORCE, GATE, strict=True)
    ]
    return [line.replace('.', ',') for line in lines] if comma else lines


HEAD = ('Time [s]', 'Force [N]', 'Stim [V]')


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'utf-16', 'utf-16-le', 'latin-1'])
@pytest.mark.parametrize(
    ('separator', 'comma'),
    [(',', False), (';', False), (';', True), ('\t', True), (' ', False), ('|', True)],
)
def test_tables_of_text(tmp_path, encoding, separator, comma):
    path = tmp_path / 'trial.csv'
    head = separator.join(name.replace(' ', '_') for name in HEAD)
    head = head.replace('Force', 'Größe_Force') if encoding == 'latin-1' else head
    path.write_text('\n'.join([head, *rows(separator, comma)]), encoding=encoding)
    expect_the_session(*imported(path))


def test_without_a_header_the_columns_are_numbered(tmp_path):
    path = tmp_path / 'trial.csv'
    path.write_text('\n'.join(rows(';')))
    file = read_signals(path)
    assert [one.name for one in file.signals] == ['column 1', 'column 2', 'column 3']
    assert 'no header' in file.facts
    expect_the_session(*imported(path))


@pytest.mark.parametrize('unit', ['h', 'ns', 'samples'])
def test_a_time_in_a_unit_that_is_not_known_is_refused(tmp_path, unit):
    """It was taken for seconds, as if none had been stated."""
    path = tmp_path / 'trial.csv'
    path.write_text('\n'.join([f'Time [{unit}],Force [N],Stim [V]', *rows(',')]))
    with pytest.raises(Ambiguous, match=rf"expected a time in s, .*, got 'Time \[{unit}\]' in"):
        imported(path)
    expect_the_session(*imported(path, time_unit='s'))


@pytest.mark.parametrize('name', ['Time (Seconds)', 'Zeit [Sec]'])
def test_a_unit_of_time_may_be_spelled_out(tmp_path, name):
    path = tmp_path / 'trial.csv'
    path.write_text('\n'.join([f'{name},Force [N],Stim [V]', *rows(',')]))
    assert dict(import_file(path, ImportOptions()).facts)['time'].endswith('as the file says')


def test_times_of_day_are_times(tmp_path):
    lines = [
        f'2024-03-01 10:00:{second:06.3f};{force};{gate}'
        for second, force, gate in zip(TIME, FORCE, GATE, strict=True)
    ]
    path = tmp_path / 'trial.csv'
    path.write_text('\n'.join(['time;force;gate', *lines]))
    expect_the_session(*imported(path), late_s=36_000.0)
    facts = import_file(path, ImportOptions()).facts
    assert dict(facts)['time'] == "'time' in s, from times of day"
    with pytest.raises(RecordingError, match=r'expected no --time-unit, or s, for .* got ms'):
        imported(path, time_unit='ms')
    lines[-1] = lines[-1].replace('03-01', '03-02')
    path.write_text('\n'.join(['time;force;gate', *lines]))
    with pytest.raises(RecordingError, match=r'expected the times of one day in .* of 2 dates'):
        read_signals(path)


@pytest.mark.parametrize(
    ('head', 'columns', 'given', 'message'),
    [
        ('time,f_a [N],f_b [N],gate', (TIME, FORCE, FORCE, GATE), {}, r"'f_b \[N\]': --force COL"),
        ('time,force,gate,trigger', (TIME, FORCE, GATE, GATE), {}, "'trigger': --pulse COL deci"),
        ('a,b,c,d', (TIME[::-1], FORCE, FORCE, GATE), {'pulse': 'd', 'force': 'b'}, 'time COL or'),
        (
            'time,Force,ACC X (g),gate',
            (TIME, FORCE, GATE, GATE),
            {},
            r'Force.*--force COL decides',
        ),
        ('time,force [V],pressure,gate', (TIME, FORCE, FORCE, GATE), {}, 'in V: --force-scale N-'),
    ],
)
def test_what_is_ambiguous_names_the_option_that_decides(tmp_path, head, columns, given, message):
    path = tmp_path / 'trial.csv'
    np.savetxt(path, np.column_stack(columns), delimiter=',', header=head, comments='')
    with pytest.raises(Ambiguous, match=message):
        imported(path, **given)


COMMAS = (
    r'expected a cell for each title of .*trial\.csv, got 3 titles, 6 cells a row: '
    r'comma as decimal mark and as separator\? Export it with semicolons or tabs'
)
OLD_EXCEL = b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1' + bytes(504)
MATLAB_7_3 = bytes(512) + b'\x89HDF\r\n\x1a\n'


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'', 'expected a table in .*trial.csv, got an empty file'),
        (b'\x00\x01\x02binary\x03', 'expected a table of text in .*, got bytes that are no text'),
        (b'a,b\nc,d\n', 'expected rows of numbers below the header of .*, got none among 2 lines'),
        (b't,f\n0,1\n1,x\n', "expected numbers in .*, got 'x' in row 2"),
        (b't,f\n0,1\n1,2\n2\n', 'expected 2 cells in each row of .*, got 1 in row 3 of the'),
        (b't;f\n0,5;1,5\n0,6;1.5\n', r"got '1\.5' in row 2, where others have a decimal"),
        (b't,f,g' + 40 * b'\n0,001,0,500,0,000', COMMAS),
        (b't,f,g' + 40 * b'\n+0,001,+0,500,+0,000', COMMAS),
        (b't,f,g' + 40 * b'\n1,000e-03,5,000e-01,0,000e+00', COMMAS),
        (OLD_EXCEL, r'old format \.xls; save it as \.xlsx'),
        (MATLAB_7_3, r"as save\(..., '-v7'\) writes it, got 7.3 in .*trial"),
    ],
)
def test_what_is_no_table_is_refused_in_our_words(tmp_path, content, message):
    path = tmp_path / 'trial.csv'
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        read_signals(path)


def test_matlab(tmp_path):
    path = tmp_path / 'session.mat'
    savemat(path, {'data': {'time': TIME, 'force': FORCE, 'trigger': GATE}, 'note': 'left leg'})
    assert read_signals(path).kind == 'MATLAB'
    expect_the_session(*imported(path))
    savemat(path, {'fs': 1000.0, 'force': FORCE, 'stim': GATE})
    expect_the_session(*imported(path))
    savemat(path, {'data': np.column_stack((FORCE, GATE))})
    expect_the_session(*imported(path, sampling_rate=1000.0, force='data 1', pulse='data 2'))


STATED = {'fs': 1000.0, 'force': FORCE, 'stim_times': TIME[ONSETS]}


@pytest.mark.parametrize('late_s', [0.001, 5.0, -0.02])
def test_times_beside_the_rate_that_a_matlab_file_states_are_those_of_the_samples(
    tmp_path, late_s
):
    path, late = tmp_path / 'session.mat', {'t': TIME + late_s}
    savemat(path, {**STATED, **late, 'stim_times': TIME[ONSETS] + late_s})
    pulses, forces = imported(path)
    expect_the_session(pulses, forces, late_s=late_s % 1.0 if late_s < 0.0 else late_s)
    paused = np.where(TIME < 0.1, TIME, TIME + 10.0)
    savemat(path, {**STATED, 't': paused, 'stim_times': paused[ONSETS]})
    pulses, forces = imported(path)
    np.testing.assert_allclose(forces.stamp_ns, 1e9 * paused, atol=1.0)
    assert pulses.onset_ns.tolist() == forces.stamp_ns[ONSETS].tolist()


def test_times_that_contradict_the_rate_that_a_file_states_are_not_guessed(tmp_path):
    path = tmp_path / 'session.mat'
    savemat(path, {**STATED, 't': TIME / 1.005})
    message = r"expected times of 1000 samples a second in .*, got 't' with 1005: --time COL or"
    with pytest.raises(Ambiguous, match=message):
        imported(path)
    expect_the_session(*imported(path, sampling_rate=1000.0))
    assert imported(path, time='t')[1].stamp_ns[-1] == pytest.approx(1e9 * TIME[-1] / 1.005)


@pytest.mark.parametrize(
    'beside',
    [
        # a fence post more, the times of another signal, rounded by single precision, days, hours
        {'t': np.arange(COUNT + 1) / 1000.0},
        {'time_emg': np.arange(COUNT * 3 // 2) / 1500.0},
        {'t': np.float32(TIME + 1e-5)},
        {'timestamp': 738_000.0 + TIME / 86_400.0},
        {'zeit': TIME / 3600.0},
    ],
)
def test_what_says_no_more_than_the_rate_is_no_time(tmp_path, beside):
    path = tmp_path / 'session.mat'
    savemat(path, {**STATED, **beside})
    expect_the_session(*imported(path))


def test_rounded_times_beside_a_stated_rate_do_not_contradict_it(tmp_path):
    path = tmp_path / 'trial.txt'
    lines = [
        f'{place / 2048:.4f}\t{line.partition(chr(9))[2]}' for place, line in enumerate(rows('\t'))
    ]
    path.write_text('\n'.join(['Sample Frequency (Hz): 2048', 't\tForce\tStim', *lines]))
    stamp_ns = imported(path)[1].stamp_ns
    np.testing.assert_allclose(stamp_ns, 1e9 * np.arange(COUNT) / 2048, atol=1.0)


def test_a_force_may_be_called_a_minimum(tmp_path):
    path = tmp_path / 'trial.txt'
    path.write_text('\n'.join(['Time [s]\tForce min\tStim', *rows('\t')]))
    expect_the_session(*imported(path))


@pytest.mark.parametrize('given', [{'sampling_rate': 2000.0}, {'time_unit': 'ms'}])
def test_signals_with_times_of_their_own_take_no_rate_and_no_unit(tmp_path, given):
    path = tmp_path / 'leg.mat'
    savemat(path, spike2_matlab())
    with pytest.raises(RecordingError, match=r"expected no --sampling-rate .* for 'Force', whic"):
        imported(path, **given)


def test_a_spike2_channel_of_levels_is_one_pulse_each_time_it_goes_up(tmp_path):
    path, channels = tmp_path / 'leg.mat', spike2_matlab()
    times = np.add.outer(0.25 + TIME[ONSETS], [0.0, 0.005]).reshape(-1, 1)
    channels['leg_Ch3'] |= {'times': times, 'level': np.tile([1, 0], len(ONSETS))[:, None]}
    savemat(path, channels)
    expect_the_session(*imported(path), late_s=0.25)


def spike2_matlab(**change):
    """Channels as Spike2 exports them to MATLAB: a waveform each of force and gate, and events."""
    force = {'title': 'Force', 'comment': '', 'interval': 0.001, 'scale': 1.0, 'offset': 0.0}
    force |= {'units': 'N', 'start': 0.25, 'length': COUNT, 'values': FORCE[:, None], **change}
    event = {'title': 'Trigger', 'comment': '', 'resolution': 1e-6, 'length': len(ONSETS)}
    event['times'] = 0.25 + TIME[ONSETS][:, None]
    return {'leg_Ch1': force, 'leg_Ch3': event, 'file': {'name': 'leg.smrx'}}


@pytest.mark.parametrize('other', [{'emg': {'fs': 2000.0}}, {'Stim': {'rate': 20.0}}])
def test_of_several_rates_in_a_matlab_file_none_is_guessed(tmp_path, other):
    path = tmp_path / 'a.mat'
    savemat(path, {**other, 'fs': 1000.0, 'force': FORCE, 'gate': GATE})
    expected = None if 'emg' in other else 1000.0
    assert read_signals(path).sampling_rate_hz == expected


def test_of_several_rates_above_a_table_none_is_guessed(tmp_path):
    """The first one was taken: of the electromyogram, twice that of the force."""
    path = tmp_path / 'a.csv'
    lines = ['Sampling rate EMG (Hz);2000', 'Sampling rate force (Hz);1000', 'Force (N);Trigger']
    path.write_text('\n'.join([*lines, *(line.split(';', 1)[1] for line in rows(';'))]))
    with pytest.raises(Ambiguous, match='--time COL or --sampling-rate HZ decides'):
        imported(path)
    path.write_text(path.read_text().replace('EMG (Hz);2000', 'EMG (Hz);1000'))
    expect_the_session(*imported(path))


def test_a_rate_that_may_be_of_another_signal_is_told_with_its_place(tmp_path):
    path = tmp_path / 'a.mat'
    savemat(path, {'emg': {'fs': 1000.0}, 'force': FORCE, 'gate': GATE})
    expect_the_session(*imported(path))
    told = dict(import_file(path, ImportOptions()).facts)
    assert 'sampling rate from emg.fs' in told['file']


def test_empty_lines_in_a_table_are_told(tmp_path):
    """By a rate, the samples after them are too early."""
    path = tmp_path / 'a.csv'
    cells = [line.split(';', 1)[1] for line in rows(';')]
    path.write_text('\n'.join(['Force (N);Trigger', *cells[:100], *[''] * 50, *cells[100:], '']))
    told = dict(import_file(path, ImportOptions(sampling_rate=1000.0)).facts)
    assert '50 empty lines left out' in told['file']


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        (
            {'time': 'time', 'sampling_rate': 2000.0},
            'expected --time or --sampling-rate, got both',
        ),
        (
            {'force_unit': 'mN', 'force_scale': 2.0},
            '--force-scale in N or Nm a unit, got it in mN',
        ),
    ],
)
def test_of_two_options_that_exclude_each_other_none_is_ignored(tmp_path, given, message):
    path = tmp_path / 'a.csv'
    np.savetxt(
        path,
        np.column_stack((TIME, FORCE, GATE)),
        '%g',
        ',',
        header='time,force,gate',
        comments='',
    )
    with pytest.raises(RecordingError, match=message):
        imported(path, **given)


def test_spike2_matlab(tmp_path):
    path = tmp_path / 'leg.mat'
    savemat(path, spike2_matlab())
    file = read_signals(path)
    assert file.kind == 'Spike2 MATLAB'
    assert [one.name for one in file.signals] == ['Force']
    assert [one.name for one in file.events] == ['Trigger']
    expect_the_session(*imported(path), late_s=0.25)
    for name in ('force', 'time'):
        with pytest.raises(RecordingError, match=r"expected column 'Trigger' in .*, got 'Force'"):
            imported(path, **{name: 'Trigger'})
    savemat(path, spike2_matlab(title='', units='mN'))
    assert [one.name for one in read_signals(path).signals] == ['leg_Ch1']
    expect_the_session(*imported(path), scale=1e-3, late_s=0.25)
    unused = {'title': 'Memory', 'comment': '', 'resolution': 1e-6, 'times': np.empty((0, 1))}
    for empty in ({}, {'level': np.empty((0, 1))}):
        savemat(path, {**spike2_matlab(), 'leg_Ch4': {**unused, **empty}})
        expect_the_session(*imported(path, pulse='Trigger'), late_s=0.25)
    savemat(path, spike2_matlab(interval=0.0))
    with pytest.raises(RecordingError, match=r'expected a waveform with an interval above 0 s'):
        read_signals(path)


def test_a_file_on_which_scipy_crashes_is_refused_in_one_line(tmp_path):
    path = tmp_path / 'session.mat'
    savemat(path, {'s': {'a': np.arange(5), 't': 'text'}})
    damaged = bytearray(path.read_bytes())
    # size of the name of a variable: SciPy reads a place that is not there
    damaged[240] = 0
    path.write_bytes(damaged)
    with pytest.raises(RecordingError, match=r'expected a MATLAB file at .* SciPy crashes \(SIG'):
        import_file(path, ImportOptions())


def workbook(path, *rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)
    return path


def test_excel(tmp_path):
    rows = zip(TIME.tolist(), FORCE.tolist(), GATE.tolist(), strict=True)
    path = workbook(tmp_path / 'session.xlsx', ['Trial of a left leg'], HEAD, *rows)
    expect_the_session(*imported(path))
    book = openpyxl.load_workbook(path)
    book.create_sheet('notes').append(['nothing'])
    book.save(path)
    with pytest.raises(RecordingError, match=r'expected one sheet in .* --sheet NAME decides'):
        read_signals(path)
    expect_the_session(*imported(path, sheet=book.sheetnames[0]))
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RecordingError, match='expected an Excel workbook at'):
        read_signals(path)


LABCHART = """Interval=\t0.001 s
ExcelDateTime=\t4.5e4\t1/1/2024 10:00:00
TimeFormat=\tStartOfBlock
ChannelTitle=\tForce\tStim
Range=\t10.000 V\t10.000 V
UnitName=\tN\tV
"""


def test_a_row_of_labchart_that_was_cut_lacks_what_is_missing(tmp_path):
    lines = ['Interval=\t0.001 s', 'ChannelTitle=\tForce\tGate', 'UnitName=\tN\tV']
    lines += [f'{at / 1000}\t1.0\t{5 if at % 50 == 10 else 0}' for at in range(1000)]
    path = tmp_path / 'a.txt'
    path.write_text('\n'.join([*lines, '1.0']))
    assert [len(one.values) for one in read_signals(path).signals] == [1001, 1001]
    assert np.isnan(read_signals(path).signals[0].values[-1])


def test_labchart_text(tmp_path):
    path = tmp_path / 'session.txt'
    lines = rows('\t')
    lines[7] += '\t#* pulse of the coil '
    path.write_text(LABCHART + '\n'.join(lines), encoding='latin-1')
    file = read_signals(path)
    assert file.kind == 'LabChart text'
    expect_the_session(*imported(path))
    path.write_text('\n'.join([LABCHART + lines[0], LABCHART + '\n'.join(lines)]))
    with pytest.raises(RecordingError, match=r'expected one block in .*, got 2: --block 1 to 2'):
        read_signals(path)
    expect_the_session(*imported(path, block=2))


def test_labchart_times_of_few_decimals_go_on_by_the_interval(tmp_path):
    path = tmp_path / 'session.txt'
    values = (line.partition('\t')[2] for line in rows('\t'))
    lines = [f'{place * 0.00025:.3f}\t{both}' for place, both in enumerate(values)]
    path.write_text(LABCHART.replace('0.001 s', '0.00025 s') + '\n'.join(lines))
    stamp_ns = imported(path)[1].stamp_ns
    np.testing.assert_allclose(stamp_ns, 250_000 * np.arange(COUNT), atol=1.0)
    # of another rate the times hold
    path.write_text(LABCHART.replace('0.001 s', '0.002 s') + '\n'.join(rows('\t')))
    expect_the_session(*imported(path))


def test_a_channel_of_labchart_without_a_title_keeps_its_place(tmp_path):
    path = tmp_path / 'session.txt'
    head = LABCHART.replace('ChannelTitle=\tForce\t', 'ChannelTitle=\t\t')
    head = head.replace('UnitName=\tN\tV', 'UnitName=\t\tV').replace('10.000 V\t10', '\t10')
    path.write_text(head + '\n'.join(rows('\t')))
    force, gate = read_signals(path).signals
    assert (force.name, force.unit, gate.name, gate.unit) == ('column 1', '', 'Stim', 'V')
    assert gate.values.max() == 5.0


def test_a_title_may_end_in_min(tmp_path):
    path = tmp_path / 'trial.csv'
    path.write_text('\n'.join(['Time min\tForce\tGate', *rows('\t', time=1 / 60)]))
    assert dict(import_file(path, ImportOptions()).facts)['time'] == (
        "'Time min' in min, as the file says"
    )


def counted(path, name, above=''):
    lines = [f'{place}\t{line.partition(chr(9))[2]}' for place, line in enumerate(rows('\t'))]
    path.write_text(f'{above}{name}\tForce\tStim\n' + '\n'.join(lines))
    return path


@pytest.mark.parametrize('name', ['Sample', 'index', '#', 'Sample No.', 'n'])
def test_a_counter_of_samples_is_no_time(tmp_path, name):
    path = counted(tmp_path / 'trial.txt', name)
    for options in ({}, {'time': name}):
        with pytest.raises(RecordingError, match=r'got .*, which counts them: --sampling-rate HZ'):
            import_file(path, ImportOptions(**options))
    expect_the_session(*imported(path, sampling_rate=1000.0))
    expect_the_session(*imported(path, time=name, time_unit='ms'))
    above = 'Stim Frequency (Hz): 100\nSample Frequency (Hz): 1000\n'
    expect_the_session(*imported(counted(path, name, above)))
    expect_the_session(*imported(counted(path, name, 'Sampling rate = 1 kHz\n')))


def test_volts_that_a_header_states_are_no_newtons(tmp_path):
    above = 'Sample Frequency (Hz): 1000\nTest Data in Volts:\n'
    path = counted(tmp_path / 'trial.txt', 'Sample', above)
    with pytest.raises(Ambiguous, match=r"got 'Force' in V: --force-scale N-PER-UNIT"):
        import_file(path, ImportOptions())
    expect_the_session(*imported(path, force_scale=2.0), scale=2.0)


XDF_HEADER = (
    '<?xml version="1.0"?><info><name>{}</name><type>F</type><channel_count>1</channel_count>'
    '<nominal_srate>{}</nominal_srate><channel_format>{}</channel_format></info>'
)


def xdf_stream(stream_id, header, samples, count):
    """Chunks of one stream, as the specification of XDF has them."""

    def chunk(tag, content):
        body = tag.to_bytes(2, 'little') + content
        return b'\x04' + len(body).to_bytes(4, 'little') + body

    number = stream_id.to_bytes(4, 'little')
    many = b'\x04' + count.to_bytes(4, 'little')
    return (
        chunk(2, number + header.encode())
        + chunk(3, number + many + samples)
        + chunk(6, number + b'<?xml version="1.0"?><info></info>')
    )


def test_xdf(tmp_path):
    pyxdf = pytest.importorskip('pyxdf')
    path, header = tmp_path / 'session.xdf', XDF_HEADER.format('force', 1000, 'double64')
    for streams in (b'', xdf_stream(1, header, b'', 0)):
        path.write_bytes(b'XDF:' + streams)
        with pytest.raises(RecordingError, match=r'expected a sampled stream in .*session\.xdf'):
            read_signals(path)
    stamped = b''.join(
        b'\x08' + np.float64(5.0 + t).tobytes() + np.float64(f).tobytes()
        for t, f in zip(TIME, FORCE, strict=True)
    )
    marks = b''.join(
        b'\x08' + np.float64(5.0 + TIME[place]).tobytes() + b'\x01\x05pulse' for place in ONSETS
    )
    path.write_bytes(
        b'XDF:'
        + xdf_stream(1, header, stamped, COUNT)
        + xdf_stream(2, XDF_HEADER.format('triggers', 0, 'string'), marks, len(ONSETS))
    )
    assert read_signals(path).kind == 'XDF'
    pulses, forces = imported(path)
    np.testing.assert_allclose(forces.force, FORCE)
    # pyxdf draws a straight line through the stamps of a regular stream: within a microsecond
    np.testing.assert_allclose(forces.stamp_ns, 1e9 * TIME, atol=1000.0)
    np.testing.assert_allclose(pulses.onset_ns, [1e6 * place for place in ONSETS], atol=1000.0)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:2000] + bytes(40) + whole[2040:]):
        path.write_bytes(damaged)
        with pytest.raises(RecordingError, match=r'expected an XDF file at .*got damage: '):
            read_signals(path)
    # to others pyxdf is as it was
    assert pyxdf.load_xdf(path)


def test_samples_that_the_streaming_layer_lost_move_no_stamp_of_the_others(tmp_path):
    pytest.importorskip('pyxdf')
    path, header = tmp_path / 'session.xdf', XDF_HEADER.format('force', 1000, 'double64')

    def force(times):
        stamped = (
            b'\x08' + np.float64(5.0 + t).tobytes() + np.float64(t).tobytes() for t in times
        )
        path.write_bytes(b'XDF:' + xdf_stream(1, header, b''.join(stamped), len(times)))
        return read_signals(path)

    kept = np.r_[0:1000, 1300:2000] * 1e-3
    found = force(kept)
    np.testing.assert_allclose(found.signals[0].time, kept, atol=1e-6)
    # buffers, which the straight line is for
    for size in (16, 27, 100):
        found = force(np.arange(2000) // size * size * 1e-3)
        np.testing.assert_allclose(np.diff(found.signals[0].time), 1e-3, rtol=0.05)


@pytest.mark.parametrize(
    ('package', 'name', 'head'),
    [('openpyxl', 'a.xlsx', b'PK\x03\x04'), ('pyxdf', 'a.xdf', b'XDF:')],
)
def test_a_package_that_is_missing_is_named(tmp_path, monkeypatch, package, name, head):
    (tmp_path / name).write_bytes(head)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RecordingError, match=rf"expected {package} for .* 'rpms_ros\[formats\]'"):
        read_signals(tmp_path / name)


def table(path, **columns):
    """Write a table of the session with other columns."""
    known = {'time': TIME, 'force': FORCE, 'stim': GATE} | columns
    pd.DataFrame(dict(zip(HEAD, known.values(), strict=True))).to_csv(path, index=False)
    return path


def test_times_that_step_back_are_told_with_their_place_and_no_number_is_no_force(tmp_path):
    late = np.where(np.arange(COUNT) < 150, TIME, TIME - 0.1)
    with pytest.raises(Ambiguous, match=r"'Time \[s\]' with 0\.149 and then 0\.05 in row 151"):
        imported(table(tmp_path / 'trial.csv', time=late))
    with pytest.raises(RecordingError, match=r"expected numbers in column 'Force .N.' of .*none"):
        imported(table(tmp_path / 'trial.csv', force=np.full(COUNT, np.nan)))


def test_what_is_missing_or_not_stated_is_told(tmp_path):
    force = FORCE.copy()
    force[20:25] = np.nan
    names = dict(zip(('time', 'force', 'pulse'), HEAD, strict=True))
    found = import_file(table(tmp_path / 'trial.csv', force=force), ImportOptions(**names))
    assert ('missing', '5 samples of the force are no finite number') in found.facts
    assert found.guessed
    # everything is named, and the units stand in the names
    assert not import_file(table(tmp_path / 'whole.csv'), ImportOptions(**names)).guessed


@pytest.mark.parametrize(
    ('begun', 'match'),
    [(False, 'got .*corrupt'), (True, 'got ')],
    ids=['zeros', 'behind a header'],
)
def test_zeros_are_no_matlab_file(tmp_path, begun, match):
    """To step on through so many, which take no room, would last longer than a test may."""
    path = tmp_path / 'zeros.mat'
    if begun:
        savemat(path, {})
    with path.open('ab') as file:
        file.truncate(1 << 34)
    with pytest.raises(RecordingError, match=rf'expected a MATLAB file at .*zeros\.mat, {match}'):
        read_signals(path)


@pytest.mark.parametrize(
    ('separator', 'row', 'cell'),
    [
        (';', '1.058,403;0,500', '1.058,403'),
        ('\t', '1,058.403\t0.500', '1,058.403'),
        (',', '"1,058.403",0.500', '1,058.403'),
        (';', "1'058.403;0.500", "1'058.403"),
        (';', '1\N{NARROW NO-BREAK SPACE}058,403;0,500', '1\N{NARROW NO-BREAK SPACE}058,403'),
        (';', '-1.058.403;0,500', '-1.058.403'),
        # would be read as a little more than one
        (';', '1.058;0,500', '1.058'),
    ],
)
def test_marks_between_thousands_are_named(tmp_path, separator, row, cell):
    path = tmp_path / 'trial.csv'
    path.write_text(f'time [ms]{separator}force [N]\n{row}\n{row}\n', encoding='utf-8')
    with pytest.raises(RecordingError) as refused:
        read_signals(path)
    assert str(refused.value) == (
        f'expected numbers without marks between thousands in {path}, got {cell!r}; '
        'export it without them'
    )


def test_a_quote_within_a_quoted_title_is_one(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('\n'.join(['Time [s],"Force ""left"" [N]",""', *rows(',')]))
    assert [one.name for one in read_signals(path).signals[1:]] == ['Force "left" [N]', 'column 3']


def written(path, titles, cells=lambda row: row, count=1000):
    """Write a table of a force of 1 to 7 whose rows `cells` may change; return what is read."""
    rows = [[f'{t / 1000:.3f}', str(1 + t % 7), str(5 * (t % 50 == 10))] for t in range(count)]
    path.write_text('\n'.join([*titles, *(','.join(cells(row)) for row in rows)]))
    return import_file(path, ImportOptions())


@pytest.mark.parametrize('text', ['OVLD', '#WERT!'])
def test_a_text_in_the_first_rows_of_numbers_is_named(tmp_path, text):
    """Else the last of these rows were the titles, and their units were lost."""

    def clipped(row):
        return [row[0], text, row[2]] if float(row[0]) < 0.005 else row

    with pytest.raises(RecordingError, match=rf'got {text!r} in the row that begins with 0\.000'):
        written(tmp_path / 'a.csv', ['Time [s],Force [kg],Gate'], clipped)


@pytest.mark.parametrize('first', ['', 'nan', '#'])
def test_a_title_of_a_column_of_numbers_may_be_missing(tmp_path, first):
    """As that of the index is, where a program in Python writes it."""
    path = tmp_path / 'a.csv'
    lines = [f'{at},{at / 1000},{1 + at % 7},{5 * (at % 50 == 10)}' for at in range(1000)]
    path.write_text('\n'.join([f'{first},Time [s],Force [kg],Gate', *lines]))
    found = import_file(path, ImportOptions(time='Time [s]'))
    assert found.forces.force[0] == pytest.approx(9.80665)


def test_a_line_above_the_titles_may_begin_with_a_number(tmp_path):
    found = written(tmp_path / 'a.csv', ['1000,Hz,left', 'Time [s],Force [kg],Gate'])
    assert found.forces.force[0] == pytest.approx(9.80665)


@pytest.mark.parametrize('row', ['nan,nan,nan', '-,-,-', ',#N/A,'])
def test_a_row_in_which_everything_is_missing_takes_no_title_and_no_unit_away(tmp_path, row):
    found = written(tmp_path / 'a.csv', ['Time [s],Force [kg],Gate', row])
    assert found.forces.force[0] == pytest.approx(9.80665)


def test_what_a_worksheet_has_for_no_value_is_missing(tmp_path):
    found = written(
        tmp_path / 'a.csv',
        ['Time [s],Force [kg],Gate'],
        lambda row: [row[0], '#N/A', row[2]] if float(row[0]) < 0.005 else row,
    )
    assert found.forces.force[5] == pytest.approx(9.80665 * 6)
    assert np.isnan(found.forces.force[:5]).all()


@pytest.mark.parametrize(
    'name', ['Force [kg] left', 'Force (kg) 1', 'Force [kg]*', 'Force[kg]raw', 'Force [kg] (left)']
)
def test_a_unit_need_not_end_a_title(tmp_path, name):
    found = written(tmp_path / 'a.csv', [f'Time [s],{name},Gate'])
    assert found.forces.force[0] == pytest.approx(9.80665)


def test_a_unit_that_is_not_known_or_not_one_is_asked_for(tmp_path):
    for name in ('Force [oz] left', 'Force [N] [kg]'):
        with pytest.raises(Ambiguous, match=r'expected a force in N, .* --force-unit decides'):
            written(tmp_path / 'a.csv', [f'Time [s],{name},Gate'])


@pytest.mark.parametrize(
    ('titles', 'newtons'),
    [
        (['Time,Force,Gate', 's,kg,logic'], 9.80665),
        (['Time,Force,Gate', 's,kilogram,V'], 9.80665),
        (['Time,Force,Gate', 's,Newton,Volt'], 1.0),
        (['s,kg,logic'], 9.80665),
    ],
)
def test_a_row_of_units_may_hold_one_that_is_not_known(tmp_path, titles, newtons):
    found = written(tmp_path / 'a.csv', titles)
    assert found.forces.force[0] == pytest.approx(newtons)


def test_whole_numbers_with_marks_between_thousands_are_refused(tmp_path):
    def cells(row):
        return [row[0], f'{300 * int(row[1]):,}'.replace(',', '.'), row[2]]

    with pytest.raises(RecordingError, match=r"marks between thousands in .*, got '1\.200'"):
        written(tmp_path / 'a.csv', ['Time [s],Force [mN],Gate'], cells)
    # with decimals of another length they are none
    found = written(
        tmp_path / 'a.csv',
        ['Time [s],Force [N],Gate'],
        lambda row: [row[0], f'{10 + int(row[1]) * 0.125:g}', row[2]],
    )
    assert found.forces.force[0] == 10.125


def test_an_underscore_is_no_part_of_a_number(tmp_path):
    with pytest.raises(RecordingError, match=r"expected numbers in .*, got '1_0'"):
        written(tmp_path / 'a.csv', ['Time [s],Force [N],Gate'], lambda r: [r[0], '1_0', r[2]])


@pytest.mark.parametrize(('begin', 'added'), [(-1.5, 2), (3.8e9, -3_800_000_000)])
def test_times_that_no_stamp_can_hold_are_moved_by_whole_seconds(tmp_path, begin, added):
    found = written(
        tmp_path / 'a.csv',
        ['Time [s],Force [N],Gate'],
        lambda row: [f'{float(row[0]) + begin:.3f}', *row[1:]],
    )
    first_s = 1e-9 * found.forces.stamp_ns[0]
    assert first_s == pytest.approx(begin + added, abs=1e-6)
    assert 1e-9 * found.pulses.onset_ns[0] == pytest.approx(first_s + 0.01, abs=1e-6)
    assert f'{added} s are added to each, as' in dict(found.facts)['times']


@pytest.mark.parametrize('rows', [2, 3])
def test_intensities_that_stand_in_one_row_of_a_pulse_are_refused(tmp_path, rows):
    """Half of each, or none at all, were taken for the intensity."""
    lines = ['Time [s],Force [N],Gate,Intensity']
    for at in range(1000):
        share = 0.2 + 0.7 * (at // 50) / 20 if at % 50 == 10 else 0.0
        lines.append(f'{at / 1000},1.0,{5 if 0 <= at % 50 - 10 < rows else 0},{share}')
    path = tmp_path / 'a.csv'
    path.write_text('\n'.join(lines))
    with pytest.raises(RecordingError, match=r"while a pulse lasts in 'Intensity', got several"):
        import_file(path, ImportOptions(intensity='Intensity'))


def test_a_file_of_intensities_says_which_column_they_are(tmp_path):
    shares, path = tmp_path / 'shares.csv', tmp_path / 'a.csv'
    head, options = ['Time [s],Force [N],Gate'], {'intensity': str(shares)}
    written(path, head)
    for titles, one in (('Intensity', '0,51'), ('time_s,share', '0.1,0.5')):
        shares.write_text('\n'.join([titles, *[one] * 20]))
        with pytest.raises(RecordingError, match=r'one column of intensities in .*, got 2'):
            import_file(path, ImportOptions(**options))
    shares.write_text('\n'.join(['time_s,intensity', *['0.1,0.5'] * 20]))
    assert set(import_file(path, ImportOptions(**options)).pulses.intensity) == {0.5}


def test_a_row_of_units_below_the_titles_counts(tmp_path):
    """A force in mN would else be a thousand times as large."""
    rows = [[at, 1000.0 + at % 7, 5.0 if at % 50 == 10 else 0.0] for at in range(1000)]
    path = workbook(tmp_path / 'leg.xlsx', ['Time', 'Force', 'Trigger'], ['ms', 'mN', 'V'], *rows)
    found = import_file(path, ImportOptions())
    assert found.forces.force[0] == pytest.approx(1.0)
    assert ('force', "'Force' in mN, as the file says") in found.facts
    assert ('time', "'Time' in ms, as the file says") in found.facts
    assert ('pulses', "'Trigger'") in found.facts


def repacked(path, change):
    """Write other content into parts of a workbook."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, content in {**parts, **change}.items():
            archive.writestr(name, content)


@pytest.mark.parametrize('part', ['xl/worksheets/sheet1.xml', 'xl/workbook.xml', 'xl/styles.xml'])
@pytest.mark.parametrize('content', [b'', b'<a', b'<a/>', b'\xff\xfe'])
def test_a_workbook_with_a_damaged_part_is_refused(tmp_path, part, content):
    path = workbook(tmp_path / 'session.xlsx')
    repacked(path, {part: content})
    with pytest.raises(RecordingError, match=r'session\.xlsx'):
        read_signals(path)
