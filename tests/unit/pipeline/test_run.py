"""Work on several processes and on clusters."""

import os
import sys
import threading

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.pipeline.solve import run
from halpipe.pipeline.solve.run import map_tasks, on_cluster


def square(number):
    return number * number


def die(number):
    os._exit(number)


def codes(caught):
    return [finding.code for finding in caught.value.diagnostics]


def test_one_job_works_here_and_in_order():
    assert list(map_tasks(square, [3, 1, 2])) == [(0, 9), (1, 1), (2, 4)]


def test_several_processes_give_the_same_results_by_position():
    assert sorted(map_tasks(square, [3, 1, 2], jobs=2)) == [(0, 9), (1, 1), (2, 4)]


def test_a_worker_that_dies_is_reported():
    with pytest.raises(HalpipeError) as caught:
        list(map_tasks(die, [1, 1], jobs=2))
    assert codes(caught) == ["HAL0933"]
    assert "--resume" in caught.value.diagnostics[0].help


def test_without_dask_a_cluster_is_refused_with_the_way_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(HalpipeError) as caught:
        list(map_tasks(square, [1], cluster="tcp://127.0.0.1:1"))
    assert codes(caught) == ["HAL0931"]
    assert "pip install distributed" in caught.value.diagnostics[0].help


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_a_cluster_that_does_not_answer_is_reported(monkeypatch, address):
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    monkeypatch.setattr(run, "CONNECT_SECONDS", 0.2)
    with pytest.raises(HalpipeError) as caught:
        list(map_tasks(square, [1], cluster=address))
    assert codes(caught) == ["HAL0932"]
    assert caught.value.diagnostics[0].path == address


@pytest.fixture
def fragile():
    """A cluster of one worker, on which work that killed it is not tried again."""
    distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
    ):
        yield cluster


def always():
    return True


@pytest.mark.slow  # workers are processes, and begin anew
def test_work_that_kills_the_workers_of_a_cluster_is_reported(fragile):
    with pytest.raises(HalpipeError) as caught:
        list(map_tasks(die, [1], cluster=fragile.scheduler_address))
    assert codes(caught) == ["HAL0933"]
    with on_cluster(fragile.scheduler_address) as cluster:
        assert cluster.ask(square, 3, go_on=always) == 9
        with pytest.raises(HalpipeError) as caught:
            cluster.ask(die, 1, go_on=always)
    assert codes(caught) == ["HAL0933"]
    assert "--resume" in caught.value.diagnostics[0].help


@pytest.fixture
def small():
    """A cluster inside this process."""
    distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    settings = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as cluster:
        yield cluster


def test_what_is_held_is_given_to_the_functions(small):
    with on_cluster(small.scheduler_address) as cluster:
        assert cluster.ask(square, cluster.hold(3), go_on=always) == 9


GATE = threading.Event()


def wait_at_gate():
    GATE.wait()


def test_who_waits_for_a_cluster_may_stop(small):
    asked = []

    def go_on():
        asked.append(True)
        return len(asked) < 3

    with on_cluster(small.scheduler_address) as cluster:
        try:
            assert cluster.ask(wait_at_gate, go_on=go_on) is None
        finally:
            GATE.set()
    assert len(asked) == 3


def test_a_cluster_without_workers_is_told_only_if_it_has_lost_them(monkeypatch, small):
    monkeypatch.setattr(run, "LOST_ASKS", 2)
    left = iter([True] * 6)
    with on_cluster(small.scheduler_address) as had, on_cluster(small.scheduler_address) as has_none:
        small.scale(0)
        small.sync(small._correct_state)
        has_none._had_workers = False
        assert has_none.ask(square, 3, go_on=lambda: next(left, False)) is None, "may get some"
        with pytest.raises(HalpipeError) as caught:
            had.ask(square, 3, go_on=always)
    assert codes(caught) == ["HAL0933"]
    assert caught.value.exit == 70


def test_a_scheduler_that_ends_is_a_lost_cluster(small):
    with on_cluster(small.scheduler_address) as cluster:
        cluster._client.close()
        for use in (lambda: cluster.hold(3), lambda: cluster.ask(square, 3, go_on=always)):
            with pytest.raises(HalpipeError) as caught:
                use()
            assert codes(caught) == ["HAL0933"]
