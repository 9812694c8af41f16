"""Signals that end a program in order: the table has to come to rest."""

from __future__ import annotations

import math
import signal
import time

#: Shortest time between two signals that mean something different [s]: what ends the whole group of processes on a
#: terminal, and what a launch system hands on, may reach a process twice for one Ctrl-C.
REPEAT_TIME = 0.5


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM, and SIGHUP, which the end of a terminal sends, unless it is ignored (``nohup``)."""
    always = (signal.SIGINT, signal.SIGTERM)
    if not hasattr(signal, "SIGHUP"):  # Windows
        return always
    return always if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (*always, signal.SIGHUP)


class Ending:
    """Whether this process was asked to end, when, and whether the operator has asked again.

    It takes the signals from the moment it is made.
    """

    def __init__(self) -> None:
        self._asked_at = self._hurried_at = math.inf
        self._numbers = ending_signals()
        for number in self._numbers:
            signal.signal(number, self._on_signal)

    @property
    def asked(self) -> bool:
        """True after a signal."""
        return self._asked_at < math.inf

    @property
    def hurried(self) -> bool:
        """True after a second Ctrl-C."""
        return self._hurried_at < math.inf

    def waited(self, now: float) -> float:
        """Return the time since the signal that matters.

        Parameters
        ----------
        now : float
            Time of `time.perf_counter` [s].

        Returns
        -------
        float
            Since the second Ctrl-C, or since the first signal [s]; negative before.
        """
        return now - (self._hurried_at if self.hurried else self._asked_at)

    def no_more(self) -> None:
        """Ignore further signals: the process ends."""
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, number: int, _: object) -> None:
        now = time.perf_counter()
        if not self.asked:
            self._asked_at = now
        elif number == signal.SIGINT and now > self._asked_at + REPEAT_TIME:
            self._hurried_at = min(self._hurried_at, now)
