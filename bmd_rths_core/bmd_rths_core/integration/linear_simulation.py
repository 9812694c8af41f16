"""Advance many runs of one discrete linear system at once, many steps at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace

FloatArray = NDArray[np.float64]

#: Steps of a block: the blocks of a call are advanced side by side, the steps of a block one after the other.
BLOCK = 32


class LinearSimulation:
    """Runs of x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] that differ in their first input and their start.

    Parameters
    ----------
    system : DiscreteStateSpace
        n states, p outputs, 1 + s inputs: the first is of each run its own, the others are the same for all runs.
    state : ndarray, shape (n, m)
        State of the m runs before the first step.

    Attributes
    ----------
    state : ndarray, shape (n, m)
        State before the next step; a call of `advance` puts a new array in its place.

    Notes
    -----
    The steps of a call are cut into blocks. All blocks are first advanced from zero, together, then the states at their
    beginnings follow from each other by A to the power of the block, and Aʲ times these is added to every step. This is
    exact, and a Python loop over N steps becomes one over N / `BLOCK` + 2 `BLOCK`.
    """

    def __init__(self, system: DiscreteStateSpace, state: FloatArray) -> None:
        self._system = system
        self.state = state
        powers = [np.eye(len(system.a))]
        for _ in range(BLOCK):
            powers.append(powers[-1] @ system.a)
        self._powers, self._over_block = np.array(powers[:-1]), powers[-1]

    def keep(self, runs: NDArray[np.bool_]) -> None:
        """Go on with some of the runs only.

        Parameters
        ----------
        runs : ndarray of bool, shape (m,)
            True for those that go on.
        """
        self.state = self.state[:, runs]

    def advance(self, own: FloatArray, shared: FloatArray | None = None) -> FloatArray:
        """Return the outputs of the next steps.

        Parameters
        ----------
        own : ndarray, shape (N, m)
            First input of every run.
        shared : ndarray, shape (N, s), optional
            Further inputs, when the system has any.

        Returns
        -------
        ndarray, shape (m, p, N)
        """
        a, b, c, d = self._system
        (steps, runs), size = own.shape, len(a)
        blocks = -(-steps // BLOCK)
        own = _in_blocks(own, blocks)
        drive = b[:, 0, None, None] * own[:, None]
        through = d[:, 0, None, None] * own[:, None]
        if shared is not None:
            common = _in_blocks(shared, blocks).transpose(0, 2, 1)
            drive += (b[:, 1:] @ common)[..., None]
            through += (d[:, 1:] @ common)[..., None]
        states = np.zeros((BLOCK + 1, size, blocks * runs))
        for j in range(BLOCK):
            np.matmul(a, states[j], out=states[j + 1])
            states[j + 1] += drive[j].reshape(size, -1)
        begin, ends = np.empty((blocks, size, runs)), states[-1].reshape(size, blocks, runs)
        state = self.state
        for i in range(blocks):
            begin[i] = state
            state = self._over_block @ state + ends[:, i]
        states[:-1] += self._powers @ begin.transpose(1, 0, 2).reshape(size, -1)
        left = steps % BLOCK
        self.state = states[left].reshape(size, blocks, runs)[:, -1].copy() if left else state
        through += (c @ states[:-1]).reshape(through.shape)
        # From step in block, output, block, run.
        outputs: FloatArray = through.transpose(3, 1, 2, 0).reshape(runs, len(c), -1)[..., :steps]
        return outputs


class SimulationFromRest:
    """Outputs of one linear system with one input, from rest; a third of the time of `LinearSimulation`.

    Only the states at the beginnings of the blocks are computed. What the steps of a block add is a product with the
    impulse response.

    Parameters
    ----------
    system : DiscreteStateSpace
        One input, p outputs.
    """

    def __init__(self, system: DiscreteStateSpace) -> None:
        a, b, c, d = system
        length = 2 * BLOCK
        of_inputs, of_states = [b[:, 0]], [c]
        for _ in range(length - 1):
            of_inputs.append(a @ of_inputs[-1])
            of_states.append(of_states[-1] @ a)
        impulse = np.vstack((d[:, 0], np.array(of_inputs[:-1]) @ c.T))
        within = np.zeros((length, len(c), length))
        for i in range(length):
            within[i:, :, i] = impulse[: length - i]
        self._within = within.reshape(-1, length)
        self._of_inputs, self._of_states = np.array(of_inputs[::-1]).T, np.vstack(of_states)
        self._over_block = np.linalg.matrix_power(a, length)

    def outputs(self, inputs: FloatArray) -> FloatArray:
        """Return the outputs of a run.

        Parameters
        ----------
        inputs : ndarray, shape (N,)
            The input.

        Returns
        -------
        ndarray, shape (p, N)
        """
        steps, length = len(inputs), self._within.shape[1]
        blocks = -(-steps // length)
        driven = np.zeros(blocks * length)
        driven[:steps] = inputs
        driven = driven.reshape(blocks, length).T
        ends, over_block = (self._of_inputs @ driven).T, self._over_block
        begin = np.zeros((blocks, len(over_block)))
        for i in range(1, blocks):
            begin[i] = over_block @ begin[i - 1] + ends[i - 1]
        outputs = self._of_states @ begin.T + self._within @ driven
        outputs = outputs.reshape(length, -1, blocks).transpose(1, 2, 0)
        return np.asarray(outputs.reshape(len(outputs), -1)[:, :steps])


def running_mean(time_step: float, time: float, runs: int) -> LinearSimulation:
    """Return the mean ȳ += min(1, Δt / τ) (u − ȳ) of one signal of many runs.

    Parameters
    ----------
    time_step : float
        Δt [s].
    time : float
        Time constant τ [s].
    runs : int
        Number of runs.
    """
    share = min(1.0, time_step / time)
    rest, new = np.array([[1.0 - share]]), np.array([[share]])
    return LinearSimulation(DiscreteStateSpace(rest, new, rest, new), np.zeros((1, runs)))


def _in_blocks(values: FloatArray, blocks: int) -> FloatArray:
    """Return rows as step in block, block, column; zeros fill the last block."""
    padded = np.zeros((blocks * BLOCK, values.shape[1]))
    padded[: len(values)] = values
    in_blocks: FloatArray = padded.reshape(blocks, BLOCK, -1).transpose(1, 0, 2)
    return in_blocks
