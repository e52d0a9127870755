"""Imitation of PBS for a job script: no PBS is needed.

A job is a copy of the script, run by bash in the user's home in a session of its own, with the
variables of `qsub -v` and those of PBS; whatever it submits waits in the queue. At its end by force
every process of the session is sent SIGTERM, and later SIGKILL.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path

QSUB = """\
#!/bin/bash
printf '%s\\n' "$@" '' >>"$PBS_QUEUE"
"""


@dataclass
class Job:
    """A running job."""

    process: subprocess.Popen[str]

    def wait(self) -> tuple[int, str]:
        output, _ = self.process.communicate(timeout=300)
        return self.process.returncode, output

    def end_by_force(self, delay: float) -> None:
        """Ends the job as PBS does at the wall time or after qdel."""
        os.killpg(self.process.pid, signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(timeout=delay)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)


class Pbs:
    """A queue whose jobs run when the test starts them."""

    def __init__(self, folder: Path, environment: dict[str, str], n_ranks: int) -> None:
        self.folder = folder
        self.queue = folder / "queue"
        self.n_jobs = 0
        for name in ("bin", "home", "work"):
            (folder / name).mkdir()
        qsub = folder / "bin/qsub"
        qsub.write_text(QSUB)
        qsub.chmod(0o755)
        nodes = folder / "nodes"
        nodes.write_text("localhost\n" * n_ranks)
        self.environment = environment | {
            "PATH": f"{folder}/bin:{environment['PATH']}",
            "PBS_QUEUE": str(self.queue),
            "PBS_NODEFILE": str(nodes),
            "PBS_O_WORKDIR": str(folder / "work"),
        }

    def waiting(self) -> list[list[str]]:
        """Arguments of each qsub so far; removes them from the queue."""
        if not self.queue.exists():
            return []
        text = self.queue.read_text()
        self.queue.unlink()
        return [job.split("\n") for job in text.split("\n\n") if job]

    def start(self, words: list[str], **more: str) -> Job:
        """Starts the job of `qsub -v LIST SCRIPT`."""
        option, settings, script = words
        assert option == "-v"
        self.n_jobs += 1
        copy = self.folder / f"{self.n_jobs}.pbs.SC"
        shutil.copyfile(self.folder / "work" / script, copy)
        variables = dict(item.partition("=")[::2] for item in settings.split(","))
        return Job(
            subprocess.Popen(
                ["bash", str(copy)], cwd=self.folder / "home", start_new_session=True, text=True,
                env=self.environment | variables | {"PBS_JOBID": f"{self.n_jobs}.pbs"} | more,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            )
        )  # fmt: skip
