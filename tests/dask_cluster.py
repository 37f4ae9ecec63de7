"""A Dask cluster on this computer."""

from collections.abc import Iterator

import pytest

QUIET = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning:(distributed|dask|tornado|zict).*"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore:Port .* is already in use:UserWarning"),
]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster: a scheduler and two workers, each a process of its own."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as started:
        assert started.scheduler_address.startswith("tcp://")
        yield started.scheduler_address
