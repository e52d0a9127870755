"""A small campaign to be interrupted: its scene, its runs and the files that they leave."""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

STOPPED = 75  # exit code
TOKEN = "ENTROSLIP_TEST_TOKEN"  # in the environment of every process of one run

SCENE = """\
&scene title = 'interrupted' seed = 7 /
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 positive = .true. /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 3.7, 41.1 /
&integration method = 'event' n_steps = 40000 /
&campaign n_samples = 300 deterministic = .true. /
&output quantities = 'slip', 'spectrum', 'energy', 'transitions' segment_length = 256 /
"""


def processes_of(token: str) -> list[int]:
    """Running processes whose environment has the token; zombies have no environment."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if f"{TOKEN}={token}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                    found.append(int(entry.name))
            except OSError:
                continue
    return found


def is_gone(pid: int) -> bool:
    """True if a process has closed its files and locks; its environment disappears earlier."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state in "ZX"


@dataclass
class Run:
    """A running program, alone (n_ranks = 0) or under mpirun."""

    program: Path
    arguments: list[str]
    folder: Path
    environment: dict[str, str]
    n_ranks: int = 0
    signalled: set[int] = field(default_factory=set)  # its processes when it was
    token: str = field(default_factory=lambda: f"{os.getpid()}-{time.monotonic_ns()}")

    def __post_init__(self) -> None:
        launcher = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(self.n_ranks)]
        words = [*(launcher if self.n_ranks else []), str(self.program), *self.arguments]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            words, cwd=self.folder, env=self.environment | {TOKEN: self.token},
            stdout=pipe, stderr=pipe, text=True,
        )  # fmt: skip

    def ranks(self) -> list[int]:
        """Process numbers of the ranks that have started."""
        if not self.n_ranks:
            return [self.process.pid]
        return [pid for pid in processes_of(self.token) if pid != self.process.pid]

    def signal(self, number: int, pids: list[int]) -> None:
        self.signalled.update(processes_of(self.token))
        for pid in pids:
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                continue

    def wait(self, timeout: float = 300.0) -> tuple[int, str, str]:
        """Exit code and output, after the last process of the run has ended."""
        output, errors = self.process.communicate(timeout=timeout)
        limit = time.monotonic() + timeout
        while processes_of(self.token) or not all(map(is_gone, self.signalled)):
            assert time.monotonic() < limit, f"processes of a dead run live on: {self.arguments}"
            time.sleep(0.01)
        return self.process.returncode, output, errors

    def stop(self, number: int, pids: list[int]) -> str:
        """Sends a signal; returns the output of a run that ends early and can be continued."""
        self.signal(number, pids)
        code, output, errors = self.wait()
        assert code == STOPPED, errors
        return output


def shards_of(output: Path, pattern: str = "c*.h5") -> dict[str, tuple[int, int]]:
    """Inode and time of each finished shard; both differ if it is rewritten."""
    found = {}
    with contextlib.suppress(FileNotFoundError):  # the folder is gone: the results are there
        for path in Path(f"{output}.shards").glob(pattern):
            with contextlib.suppress(FileNotFoundError):  # so is this one
                stat = path.stat()
                found[path.name] = (stat.st_ino, stat.st_mtime_ns)
    return found


def processes_kept(output: Path) -> dict[str, tuple[int, int]]:
    """Inode and time of each stored process."""
    return shards_of(output, "process_p*.h5")


def wait_for_shards(run: Run, output: Path, at_least: int, found=shards_of) -> None:
    limit = time.monotonic() + 120
    while len(found(output)) < at_least:
        assert run.process.poll() is None, "the run ended before it was interrupted"
        assert time.monotonic() < limit, "no shard appears"
        time.sleep(0.002)
