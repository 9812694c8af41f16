"""Pieces of a study in this process, in others and on a cluster: the same results."""

import sys

import pytest

from bmd_rths_core.campaign.motions import read_motions
from bmd_rths_core.campaign.study import Study
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_nodes.campaign.pool import PieceRunner, in_process, in_processes, on_cluster


@pytest.fixture
def study(records):
    return Study(Config(), read_motions(records).motions, ["uc", "plc"], {"run.seed": [0, 1]})


@pytest.mark.slow
def test_processes_give_the_same_results_in_any_order(study):
    run = PieceRunner(None)
    expected = [result for piece in in_process(study.pieces(), run) for result in piece]
    found = [result for piece in in_processes(study.pieces(), run, jobs=2) for result in piece]
    assert sorted(found, key=lambda r: r["key"]) == sorted(expected, key=lambda r: r["key"])


@pytest.mark.slow
def test_cluster_gives_the_same_results(study):
    import distributed  # takes a second, which only this test needs

    expected = [result for piece in in_process(study.pieces(), PieceRunner(None)) for result in piece]
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        found = [r for piece in on_cluster(study.pieces(), PieceRunner(None), cluster.scheduler_address) for r in piece]
    assert sorted(found, key=lambda r: r["key"]) == sorted(expected, key=lambda r: r["key"])


def test_cluster_without_distributed_is_one_clear_line(study, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="distributed is not installed"):
        next(on_cluster(study.pieces(), PieceRunner(None), "tcp://127.0.0.1:1"))
