# Copyright 2026 rpms_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures 13 to 17, drawn anew."""

import matplotlib as mpl
import numpy as np

mpl.use('Agg')

from matplotlib import pyplot as plt

from rpms_ros.identification import CURVE_INTENSITY

LABELS = ('u_thr', 'u_sat', 'alpha_sat')
STYLE = {
    'plain derivative': ':',
    'recursive, projected': '--',
    'recursive, Table 5': '--',
    'tracking': '-',
}


def _save(figure, path):
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def _paths(axes, path, truth, style, label):
    for place, axis in enumerate(axes):
        axis.plot(path.time, path.theta[:, place], style, lw=1, label=label)
        axis.axhline(truth[place], color='0.7', lw=0.5)
        axis.set_ylabel(LABELS[place])
    axes[-1].set_xlabel('time [s]')


def parameter_paths(path, shown, kind):
    """Fig. 13: parameters over time."""
    figure, axes = plt.subplots(3, 1, figsize=(7, 6), sharex=True)
    for (which, name), result in shown.items():
        if which == kind:
            _paths(axes, result, (0.48, 0.98, 4.0), STYLE[name], name)
    axes[0].legend(fontsize=7)
    axes[2].set_ylim(0, 10)
    _save(figure, path)


def reconstruction(path, session, shown, kind):
    """Fig. 14: recruitment curve and response, identified and true."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2))
    left.plot(CURVE_INTENSITY, session.curve, color='0.7', lw=3, label='plant')
    for (which, name), result in shown.items():
        if which == kind:
            left.plot(CURVE_INTENSITY, result.last.curve_force, STYLE[name], lw=1, label=name)
            right.plot(result.last.response_time, result.last.response_force, STYLE[name], lw=1)
    left.legend(fontsize=7)
    left.set(xlabel='intensity', ylabel='steady force at 20 Hz [N]')
    right.set(xlabel='time after a pulse [s]', ylabel='force [N]')
    _save(figure, path)


def experimental_paths(path, results):
    """Fig. 15: parameters over time, one session."""
    figure, axes = plt.subplots(3, 1, figsize=(7, 6), sharex=True)
    for (name, take, label), (session, result) in results.items():
        if (name, take) == ('S1 P1', 0):
            plant = session.subject.recruitment
            truth = (plant.threshold, plant.saturation, plant.saturation_slope)
            _paths(axes, result, truth, STYLE[label], label)
    axes[0].legend(fontsize=7)
    _save(figure, path)


def curves(path, results):
    """Fig. 16: recruitment curves of all sessions."""
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.2))
    for (name, take, label), (session, result) in results.items():
        axis = axes[0 if name.startswith('S1') else 1]
        if label == 'tracking' and take == 0:
            axis.plot(CURVE_INTENSITY, session.curve, color='0.8', lw=4)
            lower, upper = result.last.curve_lower, result.last.curve_upper
            axis.fill_between(CURVE_INTENSITY, lower, upper, alpha=0.3)
        axis.plot(CURVE_INTENSITY, result.last.curve_force, STYLE[label], lw=1)
        axis.set(xlabel='intensity', ylabel='K_norm rho [N]', title=name[:2])
    _save(figure, path)


def responses(path, results):
    """Fig. 17: impulse responses of all sessions, normalised as in Sec. 3.3.4."""
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.2))
    for (name, _, label), (_, result) in results.items():
        axis = axes[0 if name.startswith('S1') else 1]
        last = result.last
        steady = max(float(np.max(last.curve_force)), 1e-9)
        axis.plot(last.response_time, last.response_force / steady, STYLE[label], lw=1)
        axis.set(xlabel='time after a pulse [s]', ylabel='h / K_norm', title=name[:2])
    _save(figure, path)
