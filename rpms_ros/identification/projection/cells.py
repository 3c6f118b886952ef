r"""What force samples say about every possible parameter set, kept in cells of one pulse each.

A cell holds the samples between two pulses.  Within it the regressors are
``phi_l(tau) = sum_k e_k(tau) z_(l-k)``: `e` depends on the time ``tau`` since the cell began and
on nothing else, the states `z` at its beginning on the parameters and on nothing else.  So the
sums ``sum e e^T``, ``sum e y``, ``sum e``, ``sum e tau`` and a few of ``y`` and ``tau`` over the
samples of a cell give the normal equations of *any* parameters exactly, without the samples.
"""

from typing import NamedTuple

import numba
import numpy as np

from rpms_ros.identification.laguerre import move_generator
from rpms_ros.pulses import FloatArray
from rpms_ros.pulses import IntArray

# Columns of `Cells.response`: sums of e y, e and e tau.
RESPONSE_FORCE, RESPONSE_ONE, RESPONSE_TIME = range(3)
# Columns of `Cells.moments`: sums of 1, tau, tau^2, y, y tau and y^2.
COUNT, TIME, TIME_SQUARED, FORCE, FORCE_TIME, FORCE_SQUARED = range(6)
# Places in `Cells.place`
HEAD, SIZE = range(2)
# A cell that no pulse ends is ended after this time [ns], so that a horizon slides in small steps.
LONGEST_CELL_NS = 250_000_000


class Cells(NamedTuple):
    """Ring of cells, oldest at ``place[HEAD]``, ``place[SIZE]`` of them.

    Attributes
    ----------
    start_ns : ndarray of int64 (capacity,)
        When the cell's pulse begins to act, latency included [ns].
    intensity : ndarray (capacity,)
        Intensity of that pulse; 0 if the cell began without one.
    weight : ndarray (capacity,)
        Factor of its recruitment (repetition rate).
    move : ndarray (capacity, functions)
        Generator of the transition from the cell before.
    gram : ndarray (capacity, functions, functions)
        Sums of e e^T.
    response : ndarray (capacity, functions, 3)
        Sums of e y, e, e tau.
    moments : ndarray (capacity, 6)
        Sums of 1, tau, tau^2, y, y tau, y^2.
    place : ndarray of int64 (2,)
        Where the ring begins, and how many cells it holds.
    """

    start_ns: IntArray
    intensity: FloatArray
    weight: FloatArray
    move: FloatArray
    gram: FloatArray
    response: FloatArray
    moments: FloatArray
    place: IntArray


def empty_cells(capacity: int, functions: int) -> Cells:
    """Return a ring without cells."""
    return Cells(
        start_ns=np.zeros(capacity, dtype=np.int64),
        intensity=np.zeros(capacity),
        weight=np.zeros(capacity),
        move=np.zeros((capacity, functions)),
        gram=np.zeros((capacity, functions, functions)),
        response=np.zeros((capacity, functions, 3)),
        moments=np.zeros((capacity, 6)),
        place=np.zeros(2, dtype=np.int64),
    )


def grown(cells: Cells, capacity: int) -> Cells:
    """Return the same cells in a longer ring that begins at 0."""
    larger = empty_cells(capacity, cells.move.shape[1])
    head, size = (int(value) for value in cells.place)
    order = (head + np.arange(size)) % len(cells.start_ns)
    for source, target in zip(cells[:-1], larger[:-1], strict=True):
        target[:size] = source[order]
    larger.place[SIZE] = size
    return larger


@numba.njit(cache=True)
def newest(cells: Cells) -> int:
    """Return the place of the newest cell; there must be one."""
    place: int = (cells.place[HEAD] + cells.place[SIZE] - 1) % len(cells.start_ns)
    return place


@numba.njit(cache=True)
def open_cell(
    cells: Cells, start_ns: int, intensity: float, weight: float, rate: float, fresh: bool
) -> int:
    """Begin a cell, at the cost of the oldest if the ring is full; return its place.

    `rate` is 2 p [1/s].  A fresh cell knows nothing of what was before: its clock may differ.
    """
    capacity = len(cells.start_ns)
    if cells.place[SIZE] == capacity:
        cells.place[HEAD] = (cells.place[HEAD] + 1) % capacity
        cells.place[SIZE] -= 1
    before = newest(cells)
    cells.place[SIZE] += 1
    here = newest(cells)
    if fresh or cells.place[SIZE] == 1:
        cells.move[here] = 0.0
    else:
        distance = rate * 1e-9 * (start_ns - cells.start_ns[before])
        move_generator(distance, cells.move[here])
    cells.start_ns[here] = start_ns
    cells.intensity[here] = intensity
    cells.weight[here] = weight
    cells.gram[here] = 0.0
    cells.response[here] = 0.0
    cells.moments[here] = 0.0
    return here


@numba.njit(cache=True)
def add_sample(cells: Cells, here: int, tau: float, force: float, values: FloatArray) -> None:
    """Add a sample `tau` seconds into the cell; `values` (functions,) holds e(tau)."""
    gram = cells.gram[here]
    response = cells.response[here]
    moments = cells.moments[here]
    for row in range(len(values)):
        value = values[row]
        for column in range(len(values)):
            gram[row, column] += value * values[column]
        response[row, RESPONSE_FORCE] += value * force
        response[row, RESPONSE_ONE] += value
        response[row, RESPONSE_TIME] += value * tau
    moments[COUNT] += 1.0
    moments[TIME] += tau
    moments[TIME_SQUARED] += tau * tau
    moments[FORCE] += force
    moments[FORCE_TIME] += force * tau
    moments[FORCE_SQUARED] += force * force
