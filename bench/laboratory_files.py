# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The same short session in every format that `rpms import` reads, for `hostile_files.py`."""

from pathlib import Path

import h5py
import numpy as np
import openpyxl
from scipy.io import savemat

FORMATS = ('text', 'labchart', 'spike2', 'matlab', 'spike2 matlab', 'matlab 7.3', 'xlsx', 'xdf')
COUNT = 200
TIME = np.arange(COUNT) / 1000.0
FORCE = np.round(2.0 + np.sin(TIME * 30.0), 4)
GATE = np.where(np.arange(COUNT) % 50 < 3, 5.0, 0.0)
ONSETS = TIME[[50, 100, 150]]


def tables(folder: Path) -> dict[str, Path]:
    """Write the same session in every format of `rpms import`."""
    rows = list(zip(TIME.tolist(), FORCE.tolist(), GATE.tolist(), strict=True))
    lines = [f'{t:.3f}\t{f:.4f}\t{g:.1f}' for t, f, g in rows]
    endings = ('csv', 'txt', 'txt', 'mat', 'mat', 'mat', 'xlsx', 'xdf')
    paths = {
        name: folder / f'{name}.{ending}' for name, ending in zip(FORMATS, endings, strict=True)
    }
    paths['text'].write_text('\n'.join(['Time [s]\tForce [N]\tStim [V]', *lines]))
    head = 'Interval=\t0.001 s\nTimeFormat=\tStartOfBlock\nChannelTitle=\tForce\tStim\n'
    paths['labchart'].write_text('\n'.join([f'{head}UnitName=\tN\tV', *lines]))
    force = '\n'.join(f'{value:.4f}' for value in FORCE)
    triggers = '\n'.join(f'{value:.6f}' for value in ONSETS)
    paths['spike2'].write_text(
        f'"INFORMATION"\n"leg.smr"\n\n"CHANNEL"\t"1"\n"Waveform"\n"No comment"\n"Force"\n'
        f'"N"\t1.0\t0.0\n"START"\t0.00000\t0.00100\n{force}\n\n'
        f'"CHANNEL"\t"2"\n"Evt+"\n"No comment"\n"Trigger"\n\n{triggers}\n'
    )
    savemat(paths['matlab'], {'t': TIME, 'trial': {'force': FORCE, 'stim': GATE}})
    waveform = {'title': 'Force', 'interval': 0.001, 'units': 'N', 'start': 0.25, 'length': COUNT}
    waveform |= {'comment': '', 'scale': 1.0, 'offset': 0.0}
    event = {'title': 'Trigger', 'comment': '', 'resolution': 1e-6, 'length': len(ONSETS)}
    event['times'] = 0.25 + ONSETS[:, None]
    channels = {'leg_Ch1': {**waveform, 'values': FORCE[:, None]}, 'leg_Ch3': event}
    savemat(paths['spike2 matlab'], channels, do_compression=True)
    with h5py.File(paths['matlab 7.3'], 'w', userblock_size=512) as file:
        group = file.create_group('trial')
        group['time'], group['gate'] = TIME[None, :], GATE[None, :]
        group.create_dataset('force', data=FORCE[None, :], compression='gzip')
    book = openpyxl.Workbook()
    for row in (['Time [s]', 'Force [N]', 'Trigger'], *map(list, rows)):
        book.active.append(row)
    book.save(paths['xlsx'])
    paths['xdf'].write_bytes(xdf())
    return paths


def xdf() -> bytes:
    """Return two streams, as the specification of XDF has them."""

    def chunk(tag: int, content: bytes) -> bytes:
        body = tag.to_bytes(2, 'little') + content
        return b'\x04' + len(body).to_bytes(4, 'little') + body

    def stream(number: int, name: str, rate: int, kind: str, samples: list[bytes]) -> bytes:
        own = number.to_bytes(4, 'little')
        header = (
            f'<?xml version="1.0"?><info><name>{name}</name><type>F</type>'
            f'<channel_count>1</channel_count><nominal_srate>{rate}</nominal_srate>'
            f'<channel_format>{kind}</channel_format></info>'
        )
        many = b'\x04' + len(samples).to_bytes(4, 'little')
        end = b'<?xml version="1.0"?><info></info>'
        return (
            chunk(2, own + header.encode())
            + chunk(3, own + many + b''.join(samples))
            + chunk(6, own + end)
        )

    force = [
        b'\x08' + np.float64(5.0 + t).tobytes() + np.float64(f).tobytes()
        for t, f in zip(TIME, FORCE, strict=True)
    ]
    marks = [b'\x08' + np.float64(5.0 + t).tobytes() + b'\x01\x05pulse' for t in ONSETS]
    return (
        b'XDF:'
        + stream(1, 'force', 1000, 'double64', force)
        + stream(2, 'triggers', 0, 'string', marks)
    )
