"""The parallel loop over a cluster, with one of this process in the place of Ray's or Dask's."""

import sys

import numpy as np
import pytest
from joblib import delayed

from glassgait.models.errors import InputError
from glassgait.studies.common.parallel.cluster import AHEAD, LARGE, run_on_cluster
from glassgait.studies.common.parallel.loop import run_parallel


class Fake:
    """Makes the calls that are sent in the opposite order, when they are waited for."""

    def __init__(self, n_cores=2):
        self._n_cores = n_cores
        self._n_sent = 0
        self.arrays = []
        self.running = {}
        self.most = 0
        self.cancelled = []

    def n_cores(self):
        return self._n_cores

    def put(self, array):
        self.arrays.append(array)
        return "array", len(self.arrays) - 1

    def send(self, function, values, named):
        self._n_sent += 1
        self.running[self._n_sent] = (function, values, named)
        self.most = max(self.most, len(self.running))
        return self._n_sent

    def first_done(self, tickets):
        assert set(tickets) == set(self.running)
        return max(tickets)

    def result(self, ticket):
        function, values, named = self.running.pop(ticket)
        return function(*values, **named)

    def cancel(self, tickets):
        self.cancelled += tickets


def _calls(n_calls):
    return (delayed(abs)(-i) for i in range(n_calls))


def test_results_come_in_the_order_of_the_calls_whichever_is_done_first():
    assert list(run_on_cluster(Fake(), _calls(9), 3, in_order=True)) == list(range(9))


def test_results_come_as_soon_as_they_are_there_where_no_order_is_asked_for():
    assert next(run_on_cluster(Fake(), _calls(9), 3, in_order=False)) == 2
    assert sorted(run_on_cluster(Fake(), _calls(9), 3, in_order=False)) == list(range(9))


@pytest.mark.parametrize(("n_jobs", "most"), [(1, 1), (3, 3), (-1, 4 * AHEAD)])
def test_no_more_calls_are_sent_than_run_at_once(n_jobs, most):
    cluster = Fake(n_cores=4)
    list(run_on_cluster(cluster, _calls(20), n_jobs, in_order=False))
    assert cluster.most == most


def test_calls_wait_for_a_cluster_that_has_no_node_yet():
    assert list(run_on_cluster(Fake(n_cores=0), _calls(3), -1, in_order=True)) == [0, 1, 2]


def test_a_large_array_is_sent_once_for_all_calls():
    cluster = Fake()
    large, small = np.zeros(LARGE // 8), np.zeros(3)
    calls = (delayed(lambda first, second: (first, second))(large, second=small) for _ in range(3))
    for first, second in run_on_cluster(cluster, calls, 1, in_order=True):
        assert first == ("array", 0)
        assert second is small
    assert len(cluster.arrays) == 1


def test_abandoned_calls_are_cancelled():
    cluster = Fake()
    results = run_on_cluster(cluster, _calls(9), 3, in_order=False)
    next(results)
    results.close()
    assert len(cluster.cancelled) == 2


@pytest.mark.parametrize(("backend", "module"), [("ray", "ray"), ("dask", "distributed")])
def test_an_extra_that_is_missing_is_refused_with_the_command_that_installs_it(
    backend, module, monkeypatch
):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"pip install 'glassgait\[{backend}\]'$"):
        list(run_parallel(_calls(3), 2, backend=backend))
