"""Dask workers started or found by the cluster settings."""

import gc
import os
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path

import psutil
import pytest
from distributed import Client, LocalCluster

from shaftpose.core.errors import InputError
from shaftpose.farm import workers
from shaftpose.farm.cluster import cluster_client, slurm_cluster
from shaftpose.settings.schema import ClusterSettings, SlurmSettings

_PATIENCE_S = 5.0
SLURM = SlurmSettings(queue="long", cores=32, memory="64GB", walltime="12:00:00", jobs=4)


def settings(workers: int = 1, address: str | None = None, slurm: SlurmSettings | None = None):  # type: ignore[no-untyped-def]
    return ClusterSettings(workers=workers, address=address, slurm=slurm, hang_s=1.0)


def test_workers_of_this_machine_have_one_thread_each_and_listen_to_it_alone() -> None:
    before = set(psutil.Process().children(recursive=True))
    with cluster_client(settings(workers=2)) as client:
        assert list(client.nthreads().values()) == [1, 1]
        own = {psutil.Process(), *psutil.Process().children(recursive=True)}
        listening = {
            connection.laddr.ip
            for process in own
            for connection in process.net_connections()
            if connection.status == psutil.CONN_LISTEN
        }
        assert listening == {"127.0.0.1"}
        with pytest.raises((OSError, TypeError)):  # without this run's keys
            Client(client.scheduler.address, timeout=_PATIENCE_S, set_as_default=False)
        assert os.getpid() not in client.run(os.getpid).values()
    assert set(psutil.Process().children(recursive=True)) <= before | resource_trackers()


def resource_trackers() -> set[psutil.Process]:
    """Python's resource trackers, which live as long as this process."""
    children = psutil.Process().children()
    return {child for child in children if "resource_tracker" in " ".join(child.cmdline())}


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_ANSWER_S", 0.2)
    with (
        pytest.raises(InputError, match=r"^tcp://127\.0\.0\.1:9: no Dask"),
        cluster_client(settings(address="tcp://127.0.0.1:9")),
    ):
        pass


def test_a_scheduler_without_workers_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    with LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as idle:
        address = idle.scheduler_address
        with cluster_client(settings(address=address)):
            pass
    (warning,) = (r.getMessage() for r in caplog.records if r.name == workers.__name__)
    assert warning.startswith(f"{address}: the scheduler has no workers yet")


def test_a_worker_without_shaftpose_is_named(tmp_path: Path) -> None:
    packages = tmp_path / "packages"
    packages.mkdir()
    for path in Path(sysconfig.get_path("purelib")).iterdir():
        if "shaftpose" not in path.name:
            (packages / path.name).symlink_to(path)
    with LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        # Without `site`, only the folder's packages are found.
        dask = [sys.executable, "-S", "-m", "distributed.cli.dask_worker", address, "--no-nanny"]
        environment = {**os.environ, "PYTHONPATH": str(packages)}
        with subprocess.Popen([*dask, "--no-dashboard"], env=environment) as worker:
            try:
                with Client(address) as client:
                    client.wait_for_workers(1, timeout=60)
                with (
                    pytest.raises(InputError, match=r"no shaftpose on this Dask worker \(1 of 1\)"),
                    cluster_client(settings(address=address)),
                ):
                    pass
            finally:
                worker.terminate()


def test_a_worker_without_a_package_that_the_work_needs_is_named() -> None:
    with (
        LocalCluster(n_workers=1, host="127.0.0.1", dashboard_address=None) as cluster,
        pytest.raises(InputError, match=r"no absent-package on this Dask worker \(1 of 1\)"),
        workers.client_of(cluster.scheduler_address, "absent-package"),
    ):
        pass


def test_an_address_that_is_none_is_named() -> None:
    with (
        pytest.raises(InputError, match="carrier-pigeon://nowhere: no Dask"),
        cluster_client(settings(address="carrier-pigeon://nowhere")),
    ):
        pass


def test_a_machine_without_slurm_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", "")
    with (
        pytest.raises(InputError, match="sbatch is missing here"),
        cluster_client(settings(slurm=SLURM)),
    ):
        pass


def test_jobs_that_slurm_refuses_end_the_run_with_its_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sbatch = tmp_path / "sbatch"
    sbatch.write_text(
        "#!/bin/sh\n"
        'echo "allocation failure: invalid partition specified: long" >&2\n'
        'echo "$@" > asked\n'
        "exit 1\n"
    )
    sbatch.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    with (
        pytest.raises(InputError, match="Slurm refuses such jobs: allocation failure: invalid "
                      "partition specified: long; correct the settings"),
        cluster_client(settings(slurm=SLURM)),
    ):  # fmt: skip
        pass
    assert (tmp_path / "asked").read_text() == "--test-only\n"  # and no job was submitted


def test_slurm_jobs_have_a_worker_per_core_and_talk_tls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)  # the folder of the jobs' logs
    on_interrupt = signal.getsignal(signal.SIGINT)
    with slurm_cluster(SLURM) as started:
        assert signal.getsignal(signal.SIGINT) is on_interrupt
        script = started.job_script()
        keys = list(tmp_path.glob(".*"))
        assert {path.stat().st_mode & 0o777 for path in keys} == {0o600}
    header = {line for line in script.splitlines() if line.startswith("#SBATCH")}
    assert {"#SBATCH -p long", "#SBATCH --cpus-per-task=32", "#SBATCH -t 12:00:00"} < header
    assert "tls://" in script
    assert "--nworkers 32" in script
    assert "--nthreads 1" in script
    assert "--dashboard-address 127.0.0.1:0" in script
    assert keys
    assert all(str(path) in script for path in keys)
    del started
    gc.collect()
    assert not list(tmp_path.glob(".*"))
