# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification of recordings; the one number that says how good its predictions were."""

import math
import os
import signal
import subprocess
import sys
from unittest.mock import Mock

import numpy as np
import pytest

import rpms_ros
from rpms_ros.errors import IdentificationError
from rpms_ros.identification import (
    CURVE_INTENSITY,
    BatchEstimator,
    ModifiedRecursiveLM,
    StreamSettings,
    estimator_by_name,
    identify,
)
from rpms_ros.identification.offline import output_error
from rpms_ros.identification.quality.verdict import verdict_of
from rpms_ros.muscle import Contraction, Subject
from rpms_ros.pulses import NANOSECONDS_PER_SECOND, ForceTrace, PulseTrain

SECOND = 1_000_000_000


@pytest.mark.parametrize('back', [2, 3600])
def test_pulses_after_a_jump_back_are_used(record, back):
    first_pulses, first = record(np.random.default_rng(7).uniform(size=240), 5000 * SECOND)
    start_ns = (5012 - back) * SECOND
    later_pulses, later = record(np.random.default_rng(8).uniform(size=240), start_ns)
    pulses = PulseTrain.joined([first_pulses, later_pulses])
    forces = ForceTrace(
        np.concatenate((first.stamp_ns, later.stamp_ns)),
        np.concatenate((first.force, later.force)),
    )
    session = identify(ModifiedRecursiveLM(), pulses, forces)
    assert session.last.faults == {'clock_jump': 1, 'samples_excluded': 351}
    assert session.last.pulses == 480
    # some 4 N; a pulse that is missing leaves 1 N
    assert np.abs(session.force - session.prediction)[-8000:].max() < 0.2
    assert session.output_error.of_range < 0.02


@pytest.mark.parametrize('wrong_ns', [0, 9000 * SECOND])
def test_one_wrong_stamp_does_not_cost_the_rest(record, wrong_ns):
    pulses, forces = record(np.random.default_rng(7).uniform(size=240), 5000 * SECOND)
    forces.stamp_ns[6000] = wrong_ns
    session = identify(ModifiedRecursiveLM(), pulses, forces)
    assert session.last.faults == {'force_stamp_alone': 1}
    assert session.last.pulses == 240
    assert np.abs(session.force - session.prediction)[-5000:].max() < 0.2


@pytest.mark.parametrize(
    ('force', 'message'),
    [
        ([], 'expected at least one finite force sample'),
        ([math.nan] * 3, 'expected at least one finite force sample'),
        ([20e3, 27e3, 25e3], 'at most 10000 N or N m, got 3 samples from 20000 to 27000.*-scale'),
        ([-3e4, math.nan], 'at most 10000 N or N m, got 1 sample from.*-scale'),
    ],
)
def test_nothing_to_learn_from_and_forces_that_no_muscle_has_are_refused(force, message):
    forces = ForceTrace(np.arange(len(force)), np.array(force))
    with pytest.raises(IdentificationError, match=message):
        identify(ModifiedRecursiveLM(), PulseTrain.of([]), forces)


def test_the_batch_from_python_fits_once_for_the_whole_recording(record, monkeypatch):
    pulses, forces = record(np.random.default_rng(7).uniform(size=240))
    estimator = BatchEstimator()
    counted = Mock(wraps=estimator.estimate)
    monkeypatch.setattr(estimator, 'estimate', counted)
    session = identify(estimator, pulses, forces)
    # not ten a second, which would take as long as the recording is squared
    assert [call.args[0] for call in counted.call_args_list] == [int(forces.stamp_ns[-1])]
    assert len(session.estimates) == 1


def test_an_interrupt_waits_for_the_end_of_a_block_and_a_second_one_does_not(record, monkeypatch):
    """Raised while numba loads a function it would crash the process."""
    pulses, forces = record(np.random.default_rng(7).uniform(size=240))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    for often, taken in ((1, 1), (2, 0)):
        estimator, done = BatchEstimator(), []

        def interrupted(*given, often=often, done=done, update=estimator.update):
            for _ in range(often):
                os.kill(os.getpid(), signal.SIGINT)
            done.append(1)
            return update(*given)

        monkeypatch.setattr(estimator, 'update', interrupted)
        with pytest.raises(KeyboardInterrupt):
            identify(estimator, pulses, forces)
        assert len(done) == taken
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler


@pytest.mark.long
def test_the_output_error_does_not_depend_on_the_threads_of_blas():
    # Enough samples for BLAS to part the work.
    code = (
        'import numpy as np\n'
        'from rpms_ros.identification.offline import IdentifiedSession\n'
        'noise = np.random.default_rng(1).standard_normal((2, 300_000))\n'
        'usable = np.ones(300_000, bool)\n'
        'session = IdentifiedSession([], np.arange(300_000) * 10**6, *noise, usable)\n'
        'print(repr(session.output_error.newton))\n'
    )
    errors = {
        subprocess.run(
            [sys.executable, '-c', code],
            env={**os.environ, 'OMP_NUM_THREADS': count, 'OPENBLAS_NUM_THREADS': count},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for count in ('1', '2', '3')
    }
    assert len(errors) == 1


def test_the_batch_has_room_for_the_fastest_sensor():
    pulses = PulseTrain.regular(np.random.default_rng(0).uniform(size=50), 20.0)
    force = np.random.default_rng(1).normal(size=250_000)
    trace = ForceTrace(np.arange(len(force), dtype=np.int64) * 10_000, force)
    chosen = StreamSettings(monitors=())
    assert 'force_queue_full' not in identify(BatchEstimator(), pulses, trace, chosen).last.faults


MILLISECOND = 1_000_000


def predicted(seconds) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, a slow sinusoid of 10 N that is near zero at its end, and usable flags."""
    stamp = np.arange(1000 * seconds, dtype=np.int64) * MILLISECOND
    force = 5.0 - 5.0 * np.cos(2.0 * np.pi * 1e-9 * stamp / 10.0)
    return stamp, force, np.ones(len(stamp), dtype=np.bool_)


def test_what_counts_in_the_prediction_error():
    stamp, force, usable = predicted(40)
    error = output_error(stamp, force, force - 0.08, usable)
    # 0.08 N of a force that goes from 0 to 10 N
    assert (error.newton, error.of_range) == (pytest.approx(0.08), pytest.approx(0.008))
    prediction = force.copy()
    prediction[20_000:21_000] += 1.0
    usable[20_000:21_000] = False
    force[20_500] = 1e6
    assert output_error(stamp, force, prediction, usable) == (0.0, 0.0)
    # a clock that jumps back takes no time off
    stamp, force, usable = predicted(40)
    stamp[20_000:] -= 20_000_000_000
    prediction = force + (np.arange(40_000) < 9_000)
    assert output_error(stamp, force, prediction, usable).newton == 0.0


@pytest.mark.parametrize(('seconds', 'settled'), [(40, 10), (12, 6)])
def test_what_is_wrong_before_settling_does_not_count(seconds, settled):
    stamp, force, usable = predicted(seconds)
    prediction = force + 0.1
    prediction[: 1000 * settled] = 1e3
    # One sample at the boundary: the middle lies half a sample before its index.
    assert output_error(stamp, force, prediction, usable).newton == pytest.approx(0.1)


def test_nothing_usable_has_no_error():
    stamp, force, usable = predicted(1)
    assert np.isnan(output_error(stamp, force, force, ~usable)).all()


@pytest.fixture(name='cut', scope='module')
def cut_fixture() -> tuple[PulseTrain, ForceTrace]:
    """The part of a session from 5.02 s on."""
    generator = np.random.default_rng(5)
    pulses = PulseTrain.regular(generator.uniform(size=300), 20.0)
    muscle = Contraction(Subject())
    muscle.add_pulses(pulses.onset_ns, pulses.intensity)
    stamps = np.arange(15_000, dtype=np.int64) * 1_000_000
    force = muscle.force(stamps) + 0.02 * generator.standard_normal(len(stamps))
    begin = round(5.02 * NANOSECONDS_PER_SECOND)
    return pulses[pulses.onset_ns >= begin], ForceTrace(stamps[5020:], force[5020:])


@pytest.mark.parametrize('name', ['batch', 'recursive', 'tracking'])
def test_the_curve_is_that_of_the_muscle(cut, name):
    estimator = estimator_by_name(name)
    found = identify(estimator, *cut)
    truth = Subject().steady_force(CURVE_INTENSITY, 20.0)
    assert np.abs(found.last.curve_force - truth).max() < 0.005 * truth.max()
    # up to the first pulse that is heard, and as long as those before it may act
    excluded = round(1000 * estimator.memory) + 30
    assert found.last.faults == {'samples_excluded': pytest.approx(excluded, abs=2)}
    assert found.last.doubts == ()
    assert verdict_of(found, *cut).grade == 'good'


@pytest.mark.long
def test_a_recording_with_unheard_pulses_is_of_one_muscle(league):
    """12 % if `batch` learnt from what they left: no constant muscle, so it was followed."""
    arrays, truth = league.session('lost', 'sinusoid', 0)
    found = rpms_ros.from_arrays(*arrays).identify()
    assert found.estimator == 'batch'
    assert np.abs(found.estimates.last.curve_force - truth).max() < 0.002 * truth.max()
