"""Executors that run the cases of a sweep in new processes on this machine, or on the workers of a Dask scheduler."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import dask
import typer
from distributed import Client, LocalCluster
from distributed.utils import silence_logging_cmgr

from scenes.language.errors import MissingPartError, SceneError
from scenes.records.folder import TEMPORARY_PREFIX, disc_errors
from scenes.sweep.executors import LOOPBACK, Perform, Stopped
from scenes.sweep.flight import WORKER_TIMEOUT_S, Flight
from scenes.sweep.job import Ended, Job

CONNECT = 5.0
"""Longest time to wait for the response of a scheduler [s]."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,  # `scenes.sweep.flight` decides which cases are tried again
    "distributed.deploy.lost-worker-timeout": f"{WORKER_TIMEOUT_S}s",  # on a busy machine a worker is slow to return
    "distributed.worker.profile.enabled": False,  # the profiler would slow down the cases
    "distributed.admin.system-monitor.interval": "10s",  # frequent monitoring would slow down the cases, too
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # a paused worker would never finish
    "distributed.worker.memory.terminate": False,
}
"""Settings of the scheduler and the workers that this program starts."""
DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
"""Code that each worker runs at its start, so that it ignores Ctrl-C.

Ctrl-C on a terminal reaches all processes. Only the driver, the process that distributes the cases, handles it.
"""
WARNING = (
    "warning: the scheduler listens on {}: anyone who can connect to this address can run programs with your rights; "
    "use it only in a network that you trust"
)


@dataclass(frozen=True)
class Local:
    """`Executor` that starts worker processes on this machine for a sweep."""

    workers: int
    bind: str = LOOPBACK
    """Network address where the scheduler and the workers listen."""

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise SceneError(f"--workers: got {self.workers}, must be 1 or more")

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        """Yield how each job ended; see `Executor.run`."""
        if not jobs:
            return
        with self.connected(len(jobs)) as client:
            yield from Flight(client, perform, stopped).run(jobs)

    @contextmanager
    def connected(self, most: int) -> Iterator[Client]:
        """Start at most `most` workers, and yield the connection to their scheduler."""
        if self.bind != LOOPBACK:
            typer.echo(WARNING.format(self.bind), err=True)
        with (
            dask.config.set(SETTINGS),
            self._started(min(self.workers, most)) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            yield client

    def _started(self, workers: int) -> LocalCluster:
        try:
            return LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host=self.bind,
                dashboard_address=f"{LOOPBACK}:0",
                memory_limit=0,  # no limit
                preload=[DEAF],
                silence_logs="CRITICAL",
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise SceneError(
                f"the workers cannot be started on {self.bind}: {error} (your own program must start a sweep under "
                "if __name__ == '__main__', since each worker imports the program)"
            ) from error


@dataclass(frozen=True)
class Remote:
    """`Executor` that uses the workers of a running scheduler."""

    address: str

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        """Yield how each job ended; see `Executor.run`."""
        if not jobs:
            return
        with self.connected(len(jobs)) as client:
            hint = f"'dask worker {self.address} --nthreads 1' starts one"
            flight = Flight(client, perform, stopped, hint)
            if flight.wait_for_workers():
                require_single(client.nthreads())
                _require_folder(client, Path(jobs[0].path).parent)
                yield from flight.run(jobs)

    @contextmanager
    def connected(self, most: int) -> Iterator[Client]:
        """Yield the connection to the scheduler. All workers are used, whatever `most` is."""
        with silence_logging_cmgr("CRITICAL"):  # errors are reported as sentences
            try:
                client = Client(self.address, timeout=CONNECT, set_as_default=False)
            except (OSError, ValueError, TypeError) as error:
                raise SceneError(
                    f"--scheduler: no scheduler answers at '{self.address}'; 'dask scheduler --host {LOOPBACK}' starts "
                    "one on this machine, and says its address"
                ) from error
            with client:
                yield client


def require_single(threads: dict[str, int]) -> None:
    """Raise SceneError if a worker has several threads, since a process can run only one case at a time."""
    if many := sorted(address for address, number in threads.items() if number != 1):
        raise SceneError(
            f"the worker at {many[0]} has {threads[many[0]]} threads, must have 1: start workers by 'dask worker "
            f"ADDRESS --nthreads 1 --nworkers {threads[many[0]]}'"
        )


def _require_folder(client: Client, folder: Path) -> None:
    """Raise an error if a worker cannot import worm3d, or cannot read and write the folder of the cases."""
    probe = folder / f"{TEMPORARY_PREFIX}{secrets.token_hex(8)}.part"
    try:
        with disc_errors(folder):
            probe.write_text(probe.name)
            found = client.run(_sees, str(probe), on_error="return")
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
    for worker, sees in found.items():
        if isinstance(sees, Exception):
            raise MissingPartError(
                f"the worker at {worker} cannot run worm3d ({type(sees).__name__}: {sees}): install the packages of "
                "this machine there, in the same versions"
            )
        if not sees:
            raise SceneError(f"the worker at {worker} does not see {folder}: choose an --out that all machines share")


def _sees(probe: str) -> bool:
    """Return whether this process can read the file `probe`, which the driver wrote, and write to its folder."""
    path = Path(probe)
    with suppress(OSError), tempfile.TemporaryFile(dir=path.parent):
        return path.read_text() == path.name
    return False
