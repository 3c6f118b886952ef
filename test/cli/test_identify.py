# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""rpms identify: one JSON object, a table, figures; what it says when something is wrong."""

import json
import os
import re
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scipy.integrate import trapezoid

import rpms_ros
from rpms_ros.cli import main, parser
from rpms_ros.cli.options import INCOMPLETE
from rpms_ros.muscle import twitch
from rpms_ros.pulses import ForceTrace, PulseTrain
from rpms_ros.recording import read_recording, write_recording
from rpms_ros.report.result import FOLLOWED, NOT_A_TWITCH, IdentificationOptions, identified

# The estimator of the paper, which fits the plant of the paper.
PAPER = ('--estimator', 'recursive', '--preset', 'paper_table_4')
KEYS = [
    *('session_hash', 'schedules', 'estimator', 'unit', 'samples', 'pulses', 'duration_s'),
    *('rate_hz', 'recruitment', 'curve', 'impulse_response', 'confidence', 'identifiability'),
    *('deviation', 'physiology', 'muscle', 'output_error_n', 'output_error_of_range', 'faults'),
    *('notes', 'verdict'),
]


def test_table_and_files_with_no_latency_below_zero(rpms, short_session, tmp_path):
    folder = tmp_path / 'new' / 'results'
    code, out, _ = rpms('identify', short_session, '--out', folder)
    assert code == 0
    for word in ('batch', '10000 samples, 200 pulses', 'u_thr', 'faults', 'none'):
        assert word in out
    assert ') at intensity 0.5' in out
    document = json.loads((folder / 'result.json').read_text())
    assert list(document) == KEYS
    # the simulated muscle answers at once: the estimate lies at its bound
    found = document['physiology']
    assert all(one['lower'] >= 0.0 for one in found.values())
    # a tenth of a sample
    assert found['latency_s']['value'] < 1e-4
    assert re.search(r'delay of the model +at most \d\.\d+ ms\n', out), out
    assert (folder / 'session.png').read_bytes().startswith(b'\x89PNG')
    assert '<svg' in (folder / 'session.svg').read_text()


def test_fixed_intensity_has_no_curve(rpms, tmp_path):
    path = tmp_path / 'session'
    options = ['--schedule', 'constant', '--intensity', '0.7', '--duration', '5']
    rpms('simulate', '--out', path, *options)
    code, out, err = rpms('identify', path, '--json', *PAPER)
    document = json.loads(out)
    # the force of the paper's recursion does not come out of such a train: the verdict says so
    assert code == 3
    assert document['curve'] is None
    assert document['recruitment'] is None
    assert 'only the product of recruitment and dynamics can be identified' in err
    assert document['notes'][0] in err
    # The response is that of the applied pulses: 20 of them a second sum up to the steady force.
    response = document['impulse_response']
    area = trapezoid(response['force'], response['time_s'])
    steady = read_recording(path).forces.force[-1000:].mean()
    # The last samples are not fitted alone: the onset of the train weighs too.
    assert 20 * area == pytest.approx(steady, rel=0.03)
    _, out, _ = rpms('identify', path)
    assert 'cannot be told from one intensity' in out


def test_axis_sign_and_topics(as_json, short_session, tmp_path):
    recording = read_recording(short_session)
    path = tmp_path / 'session'
    mirrored = ForceTrace(recording.forces.stamp_ns, -recording.forces.force)
    write_recording(path, recording.pulses, mirrored, axis='x')
    names = ['--pulses-topic', '/pulses', '--force-topic', '/force', '--axis', 'x', '--sign', '-1']
    assert as_json('identify', path, '--json', *names) == as_json(
        'identify', short_session, '--json'
    )


def test_cut_off_recording_is_identified_and_told(rpms, short_session, tmp_path):
    path = tmp_path / 'cut.mcap'
    path.write_bytes((short_session / 'short_0.mcap').read_bytes())
    os.truncate(path, path.stat().st_size * 3 // 4)
    code, out, err = rpms('identify', path, '--json')
    document = json.loads(out)
    assert code == 1
    assert document['faults'] == {'truncated_file': 1}
    assert 5_000 < document['samples'] < 10_000
    assert err.startswith('rpms: warning: cut.mcap has no end')


def test_the_sample_is_what_its_script_makes(tmp_path):
    source = Path(__file__).parents[2] / 'bags' / 'make_sample.py'
    scope: dict[str, Any] = {'__name__': 'make_sample', '__file__': str(source)}
    exec(compile(source.read_text(), source, 'exec'), scope)
    assert scope['make'](tmp_path / 'sample') == 0
    made, kept = (read_recording(path) for path in (tmp_path / 'sample', scope['FOLDER']))
    assert made.pulses.onset_ns.tolist() == kept.pulses.onset_ns.tolist()
    assert made.forces.stamp_ns.tolist() == kept.forces.stamp_ns.tolist()
    # Exponentials of another C library may differ in their last bit.
    np.testing.assert_allclose(made.forces.force, kept.forces.force, rtol=1e-9, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize('estimator', ['recursive', 'batch'])
def test_the_json_is_what_the_schema_says(as_json, short_session, estimator):
    schema = json.loads((Path(__file__).parents[2] / 'docs' / 'identify.schema.json').read_text())
    document = as_json('identify', short_session, '--json', '--estimator', estimator)
    jsonschema.validate(document, schema)
    # it says something: nothing may be missing, nothing may be added
    for name in schema['required']:
        rest = {key: value for key, value in document.items() if key != name}
        with pytest.raises(jsonschema.ValidationError, match='is a required property'):
            jsonschema.validate(rest, schema)
    with pytest.raises(jsonschema.ValidationError, match='Additional properties'):
        jsonschema.validate({**document, 'colour': 'red'}, schema)


@pytest.mark.long
@pytest.mark.parametrize(
    ('change', 'code', 'word'),
    [
        (lambda force: 1.0 * force, 0, 'good: the identified muscle explains'),
        (lambda force: 102.0 * force, 1, 'doubtful: the force spans'),
        (lambda force: -force, 3, 'no: the force comes out negative'),
        (lambda force: 0.0 * force, 3, 'no: the force never changes'),
    ],
    ids=['right', 'grams', 'wrong sign', 'wrong axis'],
)
def test_the_verdict_begins_the_text_and_decides_the_exit_code(
    rpms, short_session, tmp_path, change, code, word
):
    recording = read_recording(short_session)
    forces = ForceTrace(recording.forces.stamp_ns, change(recording.forces.force))
    write_recording(tmp_path / 'session', recording.pulses, forces)
    found, out, _ = rpms('identify', tmp_path / 'session')
    assert found == code
    _, first, *_ = out.splitlines()
    assert first.startswith('  verdict ')
    assert word in ' '.join(out[out.index('  verdict ') :].split())
    # what must not be used is not printed
    assert ('u_thr' in out) is (code != 3)
    document = json.loads(rpms('identify', tmp_path / 'session', '--json')[1])
    assert word.startswith(document['verdict']['grade'])
    assert word.split(': ')[1] in document['verdict']['reasons'][0]


def test_trains_of_one_intensity_give_their_dynamics(rpms, tmp_path):
    """Eight pulses at 50 Hz; no law of how force depends on the rate has a part in it."""
    lag = np.arange(4000)[:, None] / 2000 - 1.0 - np.arange(8) / 50 - 9e-3
    force = 2.0 * twitch(lag, 15e-3, 3).sum(axis=1)
    force += 1e-3 * np.random.default_rng(1).standard_normal(len(force))
    onset = 1_000_000_000 + 20_000_000 * np.arange(8)
    pulses = PulseTrain(onset, np.full(8, 0.7), np.arange(8), np.full(8, 1e-4))
    stamps = 500_000 * np.arange(4000)
    write_recording(tmp_path / 'train', pulses, ForceTrace(stamps, force))
    code, out, _ = rpms('identify', tmp_path / 'train', '--estimator', 'batch')
    assert code == 0
    assert 'onset of force' in out
    assert '1 with 8 pulses at 50 Hz' in out
    words = ' '.join(out.split())
    # each number with the model it belongs to: that of the history law has another T_a
    delay = r'delay of the model, equal pulses [89]\.\d+ ms'
    assert re.search(rf'T_a, equal pulses 1\d\.\d+ ms .*{delay}', words)
    analyzed = ' '.join(rpms('analyze', tmp_path / 'train')[1].split())
    assert re.search(rf'T_a, equal pulses 1\d\.\d+ ms .*{delay}', analyzed)
    assert 'verdict good: dynamics only' in words
    assert re.search(r'fit equal pulses \d+\.\d %, a gain a pulse \d+\.\d %', words)
    assert '(100 (1 - |residual| / |force - mean|))' in words
    assert 'the model of the trains (equal pulses) explains' in words
    assert '% of the variance of the force' in words
    document = json.loads(rpms('identify', tmp_path / 'train', '--json')[1])
    found = document['dynamics']
    assert found['twitch_time_constant_s']['value'] == pytest.approx(15e-3, rel=0.01)
    assert found['latency_s']['value'] == pytest.approx(9e-3, abs=2e-4)
    # the pulse of the trains, not one at the rate for which curves are stated
    response = document['impulse_response']
    truth = 2.0 * twitch(np.array(response['time_s']) - 9e-3, 15e-3, 3)
    # the noise of 1 mN leaves the amplitude uncertain by less than 1 mN, T_a by 0.05 ms
    np.testing.assert_allclose(response['force'], truth, atol=0.02)
    # that of the estimator, which is not what is stated
    assert 'prediction error' not in out
    code, out, _ = rpms('identify', tmp_path / 'train', '--sign', -1)
    assert code == 3
    assert 'no: the force of a pulse comes out negative, -2 N: sign or axis' in ' '.join(
        out.split()
    )
    assert 'T_a' not in out


@pytest.mark.parametrize(
    ('options', 'preset'),
    [
        ([], 'people'),
        (['--recruitment', 'arctan'], 'arctan'),
        (['--preset', 'paper_table_4'], 'paper_table_4'),
    ],
)
def test_the_arctangents_alone_are_asked_for_by_recruitment_or_preset(options, preset):
    assert parser().parse_args(['identify', 'x', *options]).preset == preset


def test_a_session_starts_from_the_result_of_another(rpms, as_json, short_session, tmp_path):
    # this muscle answers at once, which the functions of Table 4 do too
    options = ('--json', '--estimator', 'tracking', '--preset', 'paper_table_4')
    plain = as_json('identify', short_session, *options)
    earlier = tmp_path / 'ada.json'
    earlier.write_text(json.dumps(plain))
    warm = as_json('identify', short_session, *options, '--start-from', earlier)
    # It has been right from the first pulse on; once settled both are, but for rounding.
    assert warm['output_error_n'] <= (1.0 + 1e-6) * plain['output_error_n']
    code, _, err = rpms('identify', short_session, '--start-from', earlier)
    assert code == 2
    assert 'expected an estimator that can start from an earlier session' in err
    earlier.write_text(json.dumps(plain | {'verdict': {'grade': 'no', 'reasons': ['a test']}}))
    code, _, err = rpms('identify', short_session, *options, '--start-from', earlier)
    assert code == 2
    assert 'expected a result that may be used, got verdict no' in err


def test_what_was_not_predicted_is_no_error_of_prediction(rpms, tmp_path):
    session = rpms_ros.simulate(duration=1.0, seed=2, noise=0.02)
    session.between(0.0, 0.6).save(tmp_path / 'short')
    code, out, _ = rpms('identify', tmp_path / 'short', '--json')
    document = json.loads(out)
    assert code == 1
    assert document['output_error_n'] is None
    # the force of twelve pulses is not known well either
    assert [reason.partition(' is known')[0] for reason in document['verdict']['reasons']] == [
        'too short: no sample was predicted before it was learnt',
        'the force at intensity 0.81',
    ]
    _, out, _ = rpms('identify', tmp_path / 'short')
    told = 'unknown: no usable sample was predicted before it was learnt'
    assert told in ' '.join(out.split())
    assert rpms('report', tmp_path / 'short', '--out', tmp_path / 'report.html')[0] == 1


@pytest.fixture(scope='module')
def sinusoid(tmp_path_factory):
    """A short sinusoid with noise."""
    path = tmp_path_factory.mktemp('sinusoid') / 'session'
    options = ['--schedule', 'sinusoid', '--duration', '18', '--noise', '0.02', '--quiet']
    assert main(['simulate', '--out', str(path), *options]) == 0
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    ('options', 'told'),
    [('--estimator recursive --preset arctan', True), ('--estimator batch', False)],
)
def test_a_response_that_is_no_twitch_is_told_from_the_twitch_closest_to_it(
    rpms, sinusoid, tmp_path, options, told
):
    """The functions of `recursive` begin after this muscle does: two peaks of its force differ."""
    report = tmp_path / 'report.html'
    _, out, _ = rpms('identify', sinusoid, *options.split())
    assert (NOT_A_TWITCH in ' '.join(out.split())) == told
    rpms('report', sinusoid, *options.split(), '--out', report)
    assert (f'<p>The response is {NOT_A_TWITCH}.</p>' in report.read_text()) == told


# Of `rpms simulate`: steady force at full intensity, and peak of the response to one pulse [N].
FULL, PEAK = 10.0, 3.52
# Twice what 18 s of a sinusoid with 0.2 % noise leave open, by the intervals of the estimate.
NEAR_FULL, NEAR_PEAK = 0.005, 0.03


def test_a_muscle_without_a_latency_is_no_twitch_to_the_recursion(rpms, as_json, sinusoid):
    """Its functions begin later: the curve is right, and the response is said not to be."""
    code, out, _ = rpms('identify', sinusoid, '--estimator', 'recursive')
    assert code == INCOMPLETE
    said = ' '.join(out.split())
    assert re.search(r'doubtful: .*the force 0\.\d+ s after a pulse .* is known only as', said)
    assert 'rely on neither peak' in said
    found = as_json('identify', sinusoid, '--json', '--estimator', 'recursive')
    assert found['curve']['force'][-1] == pytest.approx(FULL, rel=NEAR_FULL)


def test_a_short_sinusoid_with_noise_is_right_or_is_said_not_to_be(rpms, as_json, sinusoid):
    found = as_json('identify', sinusoid, '--json')
    assert found['estimator'] == 'batch'
    assert found['curve']['force'][-1] == pytest.approx(FULL, rel=NEAR_FULL)
    assert max(found['impulse_response']['force']) == pytest.approx(PEAK, rel=NEAR_PEAK)
    assert found['physiology']['twitch_peak_n']['value'] == pytest.approx(PEAK, rel=0.05)
    # The paper's recursion is far off, and that is said.
    code, out, _ = rpms('identify', sinusoid, *PAPER)
    assert code == 3
    assert 'no: ' in out
    assert 'steady force' not in out


def test_the_sample_of_the_readme_has_the_saturation_that_it_was_made_with(as_json):
    sample = Path(__file__).parents[2] / 'bags' / 'sample'
    found = as_json('identify', sample, '--json')
    # Simulated with u_thr 0.48 and u_sat 0.98; half a minute with 0.2 % noise tells them to 0.002.
    assert found['recruitment']['u_thr'] == pytest.approx(0.48, abs=0.005)
    assert found['recruitment']['u_sat'] == pytest.approx(0.98, abs=0.005)
    assert found['verdict']['grade'] == 'good'
    assert found['faults'] == {}
    # Noise of 0.02 N, the sharpness alpha_thr of 5 taken for 6, and a basis with 0.5 % of its own.
    assert found['output_error_of_range'] < 0.012
    assert found['curve']['force'][-1] == pytest.approx(FULL, rel=0.1)


@pytest.mark.long
def test_a_muscle_that_changed_is_followed_in_place_of_a_mixture(rpms, tmp_path):
    path = tmp_path / 'tired'
    rpms('simulate', '--out', path, '--duration', 20, '--scenario', 'fatigue', '--noise', 0.05)
    _, text, _ = rpms('identify', path, '--out', tmp_path / 'results')
    found = json.loads((tmp_path / 'results' / 'result.json').read_text())
    assert found['estimator'] == 'tracking'
    assert FOLLOWED in found['notes']
    assert 'force_percent' in found['rates']
    assert re.search('estimator +followed by tracking', text)
    recording = read_recording(path)
    tracked = identified(recording, IdentificationOptions('tracking'), most_estimates=1)
    assert found['curve']['force'] == tracked.last.curve_force.tolist()
    # Who asks for a table of the paper has chosen the model.
    fixed = identified(recording, IdentificationOptions(preset='paper_table_5'))
    assert fixed.last.estimator == 'batch'
