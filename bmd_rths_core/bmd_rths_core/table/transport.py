"""Protocol of what a table controller on a network needs of its host: datagrams and the time."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Datagram(NamedTuple):
    """What has arrived.

    Parameters
    ----------
    data : bytes
        Whatever somebody sent.
    from_controller : bool
        It came from the address of the controller.
    """

    data: bytes
    from_controller: bool


class Transport(Protocol):
    """Datagrams to one controller and back, and the clock they are timed by."""

    @property
    def is_open(self) -> bool:
        """True between `open` and `close`."""

    def open(self) -> None:
        """Make ready to send and to receive; again is allowed.

        Raises
        ------
        OSError
            An address cannot be used; the text names it.
        """

    def close(self) -> None:
        """Release everything; again is allowed."""

    def now(self) -> float:
        """Return the time of a monotonic clock [s]."""

    def send(self, data: bytes) -> float:
        """Send a datagram to the controller.

        Parameters
        ----------
        data : bytes
            The datagram.

        Returns
        -------
        float
            When it went out [s].

        Raises
        ------
        OSError
            The network refuses.
        """

    def receive(self) -> Datagram | None:
        """Return the next datagram that has arrived, without waiting; None when there is none."""

    def wait(self, until: float) -> bool:
        """Wait until a datagram is there; return whether one is.

        Parameters
        ----------
        until : float
            Longest wait, a time of `now` [s].
        """

    def sleep(self, until: float) -> None:
        """Wait until a time [s], whatever arrives.

        Parameters
        ----------
        until : float
            A time of `now` [s].
        """
