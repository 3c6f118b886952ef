# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sidecars of a BIDS dataset: what its columns mean, and what made it."""

from typing import Any

from rpms_ros import __version__

BIDS_VERSION = '1.11.0'
DRAFT = 'NIBS-BIDS (BEP 037), proposal v6.3 of July 2026'
"""What the folder nibs/ follows: https://github.com/nigelrogasch/nibs-bids."""
INTENSITY_UNIT = '% Maximum Stimulator Output'
_GENERATED = [{'Name': 'rpms_ros', 'Version': __version__}]
README = f"""\
Force of a muscle that was stimulated by repetitive pulses, written by rpms_ros {__version__}.

- beh/*_recording-force_physio.tsv.gz: force samples with their times
- beh/*_events.tsv: one row for each pulse; nibs_event_id names its parameters
- nibs/*_nibs.tsv: parameters of the pulses, as {DRAFT} has them
- derivatives/rpms_ros: estimates of the muscle that were made during the session, if any

The folder nibs/ is not part of BIDS {BIDS_VERSION}, so .bidsignore names it.  What the recording
does not tell is not stated: stimulator, coil or electrodes and where they were placed.
"""
IGNORED = '**/nibs\n'
EVENT_COLUMNS: dict[str, Any] = {
    'onset': {
        'LongName': 'Onset of the pulse',
        'Description': 'Time after the first force sample.',
        'Units': 's',
    },
    'duration': {'LongName': 'Duration of the pulse', 'Description': 'As stated.', 'Units': 's'},
    'nibs_event_id': {
        'LongName': 'Stimulation parameters',
        'Description': 'References nibs_event_id in nibs/*_nibs.tsv.',
    },
    'sequence': {
        'LongName': 'Number of the pulse',
        'Description': 'Counter of the driver; a number left out is a pulse that was not seen.',
    },
}
NIBS_COLUMNS: dict[str, Any] = {
    'nibs_event_id': {
        'LongName': 'Stimulation parameters',
        'Description': 'Identifier of a parameter set; referenced from the events.',
    },
    'nibs_type': {
        'LongName': 'Stimulation modality',
        'Description': 'A muscle is stimulated through the nerves within it.',
        'Levels': {'PNS': 'Peripheral nerve stimulation'},
    },
    'stimulus_intensity': {
        'LongName': 'Intensity',
        'Description': 'Delivered amplitude of the pulse.',
        'Units': INTENSITY_UNIT,
    },
    'stimulus_duration': {
        'LongName': 'Pulse width',
        'Description': 'Duration of the pulse.',
        'Units': 's',
    },
    'intensity_scaling': {
        'LongName': 'Scaling of the intensity',
        'Description': 'The intensity is stated directly, not as multiple of a threshold.',
        'Levels': {'absolute': 'directly specified'},
    },
}


def dataset(name: str, kind: str) -> dict[str, Any]:
    """Return the description of a dataset: ``raw`` or ``derivative``."""
    return {
        'Name': name,
        'BIDSVersion': BIDS_VERSION,
        'DatasetType': kind,
        'GeneratedBy': _GENERATED,
    }


def force_sidecar(
    unit: str, rate_hz: float, task: str, facts: dict[str, object]
) -> dict[str, Any]:
    """Return the description of the force.

    Parameters
    ----------
    unit : str
        ``N`` or ``N m``.
    rate_hz : float
        Median rate of the samples [Hz].
    task : str
        Name of the task.
    facts : dict
        What `SessionExport.facts` says.
    """
    quantity = 'force' if unit == 'N' else 'torque'
    return {
        'TaskName': task,
        'PhysioType': 'generic',
        'SamplingFrequency': rate_hz,
        'StartTime': 0,
        'Columns': ['timestamp', quantity],
        'timestamp': {
            'Description': 'Time of the sample after the first one, as it was stamped.',
            'Units': 's',
        },
        quantity: {
            'Description': f'Isometric {quantity} of the stimulated muscle, positive for a pull.',
            'Units': unit,
        },
        'RpmsRos': facts,
    }


def nibs_sidecar(events: str, task: str) -> dict[str, Any]:
    """Return the description of the pulses; `events` is the BIDS URI of their times."""
    return {
        'NIBSDescription': 'Repetitive stimulation of a muscle; one parameter set for each '
        'intensity and width that occurs.',
        'ConcurrentModalities': ['beh'],
        'IntendedFor': events,
        'TaskName': task,
        **NIBS_COLUMNS,
    }
