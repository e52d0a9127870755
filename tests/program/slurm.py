"""Slurm on one machine: one controller and one node, with all files in one folder."""

from __future__ import annotations

import getpass
import os
import secrets
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

NEEDED = ("munged", "slurmctld", "slurmd", "sbatch", "scontrol")

# Signals ahead of a wall time are looked for every 30 s; a requeued job waits for cred_expire.
CONFIGURATION = """\
ClusterName=entroslip
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/builtin
SchedulerParameters=sched_interval=1
SlurmdParameters=config_overrides
KillWait=5
ReturnToService=2
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
NodeName={host} NodeAddr=127.0.0.1 CPUs=4
PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> list[str]:
    """Programs of Slurm that are not installed; its daemons are in folders of root."""
    return [name for name in NEEDED if not where(name)]


def where(name: str) -> str | None:
    return shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin:/sbin")


def free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


class Slurm:
    """Daemons as child processes of the test; `stop` ends only these."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self.environment = environment | {"SLURM_CONF": str(folder / "slurm.conf")}
        self.daemons: list[subprocess.Popen[bytes]] = []
        for name in ("state", "spool"):
            (folder / name).mkdir()
        folder.chmod(0o700)
        key = folder / "munge.key"
        key.write_bytes(secrets.token_bytes(128))
        key.chmod(0o400)
        self.host = socket.gethostname().partition(".")[0]
        controller_port, node_port = free_ports(2)
        # named, or slurmd looks for what a container need not have: a mounted /sys/fs/cgroup
        (folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
        (folder / "slurm.conf").write_text(
            CONFIGURATION.format(
                folder=folder, host=self.host, user=getpass.getuser(),
                controller_port=controller_port, node_port=node_port,
            )
        )  # fmt: skip

    def start(self) -> None:
        files = {"socket": "socket", "key-file": "key", "log-file": "log",
                 "pid-file": "pid", "seed-file": "seed"}  # fmt: skip
        options = [f"--{option}={self.folder}/munge.{end}" for option, end in files.items()]
        self.launch("munged", "--foreground", "--force", *options)
        self.wait_until(lambda: (self.folder / "munge.socket").exists(), "munged")
        self.launch("slurmctld", "-D")
        self.launch("slurmd", "-D", "-N", self.host)
        self.wait_until(lambda: "State=IDLE" in self.ask("show", "node", self.host), "the node")

    def launch(self, name: str, *options: str) -> None:
        with (self.folder / f"{name}.out").open("wb") as log:
            self.daemons.append(
                subprocess.Popen(
                    [where(name), *options], env=self.environment, stdout=log, stderr=log
                )
            )

    def stop(self) -> None:
        for daemon in reversed(self.daemons):
            daemon.send_signal(signal.SIGTERM)
            try:
                daemon.wait(timeout=10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

    def ask(self, *words: str) -> str:
        done = subprocess.run(
            ["scontrol", *words], env=self.environment, capture_output=True, text=True, check=False
        )
        return done.stdout + done.stderr

    def state(self, job: str) -> str:
        """State of a job, such as RUNNING, or the states of all members of an array."""
        words = self.ask("show", "job", job).split()
        return " ".join(word.partition("=")[2] for word in words if word.startswith("JobState="))

    def wait_until(self, is_so, what: str, timeout: float = 120.0) -> None:
        limit = time.monotonic() + timeout
        while not is_so():
            assert time.monotonic() < limit, f"{what}: not in {timeout:.0f} s\n{self.logs()}"
            time.sleep(0.1)

    def logs(self) -> str:
        return "\n".join(
            f"{path.name}:\n{path.read_text(errors='replace')[-2000:]}"
            for path in sorted(self.folder.iterdir())
            if path.suffix in (".log", ".out")
        )
