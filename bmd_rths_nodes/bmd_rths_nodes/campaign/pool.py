"""Run the pieces of a campaign: in this process, in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any, TypeVar

from bmd_rths_core.campaign.study import FinishedRun, Piece, run_piece
from bmd_rths_core.errors import InputError

#: Pieces under way for every process: one that runs and one that waits, so that memory stays flat.
_AHEAD = 2
#: Threads of the linear algebra of a process: its matrices are small, and every core has a process of its own.
_ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")}

Results = list[dict[str, Any]]

Work = TypeVar("Work")
Done = TypeVar("Done")


class CampaignStopped(Exception):
    """The campaign does not go on; the text says why. What is finished stays."""


@dataclass(frozen=True)
class PieceRunner:
    """Compute a piece, and write the bags of its runs.

    Parameters
    ----------
    bags : Path, optional
        Folder of the bags; none are written without.
    """

    bags: Path | None

    def __call__(self, piece: Piece) -> Results:
        """Return the results of the runs of a piece.

        Parameters
        ----------
        piece : Piece
            The piece.

        Raises
        ------
        InputError
            Anything is wrong with it, or a bag cannot be written.
        """
        results = []
        for finished in run_piece(piece):
            if self.bags is not None:
                _write_bag(finished, self.bags)
            results.append(finished.result)
        return results


def in_process(pieces: Iterator[Work], run: Callable[[Work], Done]) -> Iterator[Done]:
    """Run one piece after the other.

    Parameters
    ----------
    pieces : iterator
        The pieces of the work.
    run : callable
        What to do with each.

    Yields
    ------
    Any
        What a piece gave.
    """
    return map(run, pieces)


def in_processes(pieces: Iterator[Work], run: Callable[[Work], Done], jobs: int) -> Iterator[Done]:
    """Run pieces in processes of this machine.

    Parameters
    ----------
    pieces : iterator
        The pieces of the work.
    run : callable
        What to do with each.
    jobs : int
        Number of processes.

    Yields
    ------
    Any
        What a piece gave, as they come.

    Raises
    ------
    BrokenProcessPool
        A process was killed.
    """
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)  # the processes inherit it, before they load their libraries
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin_worker)
    try:
        yield from _ahead(pieces, lambda piece: pool.submit(run, piece), _AHEAD * jobs)
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def on_cluster(pieces: Iterator[Piece], run: PieceRunner, address: str) -> Iterator[Results]:
    """Run pieces on a Dask cluster, whose workers have this project installed.

    Parameters
    ----------
    pieces : iterator of Piece
        The pieces; they bring their records with them.
    run : PieceRunner
        What to do with each; a folder for bags has to be one that all workers see.
    address : str
        Address of the scheduler.

    Yields
    ------
    list of dict
        The results of a piece, as they come.

    Raises
    ------
    InputError
        distributed is not installed, or there is no scheduler.
    """
    try:
        from distributed import Client, as_completed
    except ModuleNotFoundError:
        raise InputError("--scheduler: distributed is not installed (pip install distributed)") from None
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {address}: no scheduler: {error}") from error
    with client:
        most = _AHEAD * max(1, sum(client.nthreads().values()))
        under_way = as_completed(client.submit(run, piece, pure=False) for piece in itertools.islice(pieces, most))
        for future in under_way:
            for piece in itertools.islice(pieces, 1):
                under_way.add(client.submit(run, piece, pure=False))
            yield future.result()


def bag_of(result: dict[str, Any], bags: Path) -> Path:
    """Return where the bag of a run is.

    Parameters
    ----------
    result : dict
        The result of the run.
    bags : Path
        Folder of the bags.
    """
    return bags / f"{result['motion']}_{result['scheme']}_{result['key'][:12]}"


def has_bag(result: dict[str, Any], bags: Path) -> bool:
    """Tell whether a run has a bag that nothing was cut off.

    Parameters
    ----------
    result : dict
        The result of the run.
    bags : Path
        Folder of the bags.
    """
    from bmd_rths_msgs_py.bag_reader import bag_is_whole  # a second that campaigns without bags need not wait

    return bag_is_whole(bag_of(result, bags))


def _ahead(pieces: Iterator[Work], submit: Callable[[Work], Future[Done]], most: int) -> Iterator[Done]:
    """Keep some pieces under way and return results as they come."""
    under_way = {submit(piece) for piece in itertools.islice(pieces, most)}
    while under_way:
        done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
        under_way |= {submit(piece) for piece in itertools.islice(pieces, len(done))}
        for future in done:
            yield future.result()


def _write_bag(finished: FinishedRun, bags: Path) -> None:
    """Write a bag under its name only when it is complete."""
    from bmd_rths_msgs_py.record_bag import write_record

    if has_bag(finished.result, bags):
        return
    directory = bag_of(finished.result, bags)
    shutil.rmtree(directory, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=bags) as partial:
        os.replace(write_record(finished.run.record, Path(partial) / directory.name), directory)


def _begin_worker() -> None:
    """Leave Ctrl-C to the process that started this one, and end with it, even if it was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
