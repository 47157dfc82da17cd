"""A campaign on dask.distributed: two workers over TCP bring forth the rows that one process does."""

from __future__ import annotations

import json
import logging
import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from ridlink.campaign_runner.cluster import Cluster
from tests.cli.campaign_process import await_shards, rows_of, shards, start
from tests.loopback import free_port

distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
parquet = pytest.importorskip("pyarrow.parquet", reason="shards need the extra 'export'")

pytestmark = [
    pytest.mark.programs,
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning"),
]

CAMPAIGN = [
    "--scenario", "crossing", "--definition", "snmac,candidate2", "--dynamics", "ideal,px4", "--loss", "0,0.3",
    "--runs", 65,
]  # fmt: skip
SHARDS = 8 * 2


@pytest.fixture(scope="module")
def cluster() -> Iterator[object]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, protocol="tcp", host="127.0.0.1", dashboard_address=":0",
        silence_logs=50,
    ) as running:  # fmt: skip
        yield running


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("alone") / "out"
    process = start(*CAMPAIGN, "--jobs", 1, "-o", folder)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return folder


def assert_same_campaign(first: Path, second: Path) -> None:
    assert rows_of(first) == rows_of(second)
    assert len(shards(first)) == len(shards(second)) == SHARDS
    for file in shards(first):
        assert parquet.read_table(file).equals(parquet.read_table(second / file.relative_to(first)))


def test_two_workers_fly_the_rows_of_one_process(cluster: object, alone: Path, tmp_path: Path) -> None:
    process = start(*CAMPAIGN, "--scheduler", cluster.scheduler_address, "-o", tmp_path / "out", "--json")
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert len(json.loads(out)["rows"]) == 8
    assert len(err.splitlines()) == 2, err
    assert_same_campaign(alone, tmp_path / "out")


def test_an_interrupted_campaign_goes_on_elsewhere(cluster: object, alone: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    first = start(*CAMPAIGN, "--jobs", 2, "-o", folder)
    await_shards(first, folder, 2)
    first.send_signal(signal.SIGTERM)
    first.communicate(timeout=60)
    kept = {file: file.stat().st_mtime_ns for file in shards(folder)}
    assert 2 < len(kept) < SHARDS
    second = start(*CAMPAIGN, "--scheduler", cluster.scheduler_address, "-o", folder, "--resume")
    _, err = second.communicate(timeout=120)
    assert second.returncode == 0, err
    assert all(file.stat().st_mtime_ns == stamp for file, stamp in kept.items())
    assert_same_campaign(alone, folder)


def test_what_dask_says_to_itself_is_said_to_nobody(cluster: object) -> None:
    """Whoever waited for workers read "Couldn't gather 1 keys, rescheduling" among the lines of the campaign."""
    Cluster(cluster.scheduler_address, print).close()
    loggers = [name for name in logging.root.manager.loggerDict if name.split(".")[0] == "distributed"]
    assert "distributed.client" in loggers
    assert not [name for name in loggers if logging.getLogger(name).isEnabledFor(logging.ERROR)]


def test_a_worker_that_is_killed_is_replaced(cluster: object, alone: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    process = start(*CAMPAIGN, "--scheduler", cluster.scheduler_address, "-o", folder)
    await_shards(process, folder, 0)
    os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert_same_campaign(alone, folder)


def test_a_scheduler_that_is_not_there_is_said_in_one_line(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_STREAM)
    few = ["--scenario", "crossing", "--runs", 1, "-o", tmp_path / "out"]
    for address, code, text in (
        (f"tcp://127.0.0.1:{port}", 3, f"no dask scheduler answers at tcp://127.0.0.1:{port}"),
        ("tcp://127.0.0.1", 2, "write it as tcp://HOST:PORT"),
    ):
        process = start(*few, "--scheduler", address)
        out, err = process.communicate(timeout=60)
        assert (process.returncode, out) == (code, ""), err
        (line,) = err.splitlines()
        assert text in line
        assert not (tmp_path / "out").exists(), "a campaign that cannot begin leaves nothing"
    process = start(*few, "--scheduler", "tcp://127.0.0.1:1", "--jobs", 2)
    assert "--jobs and --scheduler exclude each other" in process.communicate(timeout=60)[1]


def test_who_waits_for_workers_is_told_so_and_may_end_it(alone: Path, tmp_path: Path) -> None:
    """It waited without a word."""
    folder = tmp_path / "out"
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0", silence_logs=50
    ) as cluster:
        process = start(*CAMPAIGN, "--scheduler", cluster.scheduler_address, "-o", folder)
        await_shards(process, folder, 0)
        cluster.scale(0)
        assert process.stderr is not None
        assert process.stderr.readline().startswith("campaign: 16 shards, 0 kept from before, workers of tcp://")
        assert process.stderr.readline() == (
            f"campaign: the scheduler {cluster.scheduler_address} has no workers; waiting for one: "
            f"'dask worker {cluster.scheduler_address}' starts it\n"
        )
        kept = len(shards(folder))
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
        assert (process.returncode, err.splitlines()) == (
            130, [f"campaign: {kept} of {SHARDS} shards kept, --resume goes on from there"],
        )  # fmt: skip
        assert 0 < kept < SHARDS

        process = start(*CAMPAIGN, "--scheduler", cluster.scheduler_address, "-o", folder, "--resume")
        assert "has no workers; 'dask worker" in process.communicate(timeout=60)[1]
        cluster.scale(1)
        cluster.wait_for_workers(1)
        process = start(*CAMPAIGN, "--scheduler", cluster.scheduler_address, "-o", folder, "--resume")
        _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert_same_campaign(alone, folder)


def test_a_worker_that_says_nothing_is_waited_for_with_a_word(tmp_path: Path) -> None:
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0", silence_logs=50
    ) as cluster:
        worker = cluster.workers[0].pid
        os.kill(worker, signal.SIGSTOP)
        try:
            process = start("--scenario", "crossing", "--scheduler", cluster.scheduler_address, "-o", tmp_path / "out")
            assert process.stderr is not None
            assert process.stderr.readline() == (
                f"campaign: waiting for the workers of {cluster.scheduler_address} to say which version they have\n"
            )
            process.send_signal(signal.SIGINT)
            assert (process.communicate(timeout=60)[1].strip(), process.returncode) == ("", 130)
        finally:
            os.kill(worker, signal.SIGCONT)


def test_a_port_that_takes_connections_and_says_nothing_is_no_scheduler(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        process = start("--scenario", "crossing", "--scheduler", address, "-o", tmp_path / "out")
        _, err = process.communicate(timeout=60)
    assert process.returncode == 3
    assert err == f"ridlink: no dask scheduler answers at {address}; 'dask scheduler' starts one\n"


def test_a_scheduler_without_workers_is_said_in_one_line(tmp_path: Path) -> None:
    with distributed.LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=":0", silence_logs=50) as empty:
        process = start("--scenario", "crossing", "--runs", 1, "-o", tmp_path, "--scheduler", empty.scheduler_address)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 3
    assert "has no workers" in err.splitlines()[-1]
