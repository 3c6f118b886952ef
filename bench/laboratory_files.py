# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The same short session in every format that `rpms import` reads, for `hostile_files.py`."""

from pathlib import Path

import numpy as np
import openpyxl
from scipy.io import savemat

FORMATS = ('text', 'labchart', 'matlab', 'spike2 matlab', 'xlsx')
COUNT = 200
TIME = np.arange(COUNT) / 1000.0
FORCE = np.round(2.0 + np.sin(TIME * 30.0), 4)
GATE = np.where(np.arange(COUNT) % 50 < 3, 5.0, 0.0)
ONSETS = TIME[[50, 100, 150]]


def tables(folder: Path) -> dict[str, Path]:
    """Write the same session in every format of `rpms import`."""
    rows = list(zip(TIME.tolist(), FORCE.tolist(), GATE.tolist(), strict=True))
    lines = [f'{t:.3f}\t{f:.4f}\t{g:.1f}' for t, f, g in rows]
    endings = ('csv', 'txt', 'mat', 'mat', 'xlsx')
    paths = {
        name: folder / f'{name}.{ending}' for name, ending in zip(FORMATS, endings, strict=True)
    }
    paths['text'].write_text('\n'.join(['Time [s]\tForce [N]\tStim [V]', *lines]))
    head = 'Interval=\t0.001 s\nTimeFormat=\tStartOfBlock\nChannelTitle=\tForce\tStim\n'
    paths['labchart'].write_text('\n'.join([f'{head}UnitName=\tN\tV', *lines]))
    savemat(paths['matlab'], {'t': TIME, 'trial': {'force': FORCE, 'stim': GATE}})
    waveform = {'title': 'Force', 'interval': 0.001, 'units': 'N', 'start': 0.25, 'length': COUNT}
    waveform |= {'comment': '', 'scale': 1.0, 'offset': 0.0}
    event = {'title': 'Trigger', 'comment': '', 'resolution': 1e-6, 'length': len(ONSETS)}
    event['times'] = 0.25 + ONSETS[:, None]
    channels = {'leg_Ch1': {**waveform, 'values': FORCE[:, None]}, 'leg_Ch3': event}
    savemat(paths['spike2 matlab'], channels, do_compression=True)
    book = openpyxl.Workbook()
    for row in (['Time [s]', 'Force [N]', 'Trigger'], *map(list, rows)):
        book.active.append(row)
    book.save(paths['xlsx'])
    return paths
