"""Kills a campaign at random instants, again and again, and resumes it after each.

    python -m tests.program.torture --kills 200

Runs without mpirun and runs of 1 to 4 ranks take turns on the same campaign. Whenever it gets
through, its results are compared, bit for bit, with those of an uninterrupted run on two ranks;
nothing that was finished may be computed twice; and a killed run may leave whole shards, but no
results file. The environment says nothing of threads of BLAS: mpirun binds ranks to a core, a run
without it sees all of them.
"""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import tempfile
import time
from pathlib import Path

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT, PROGRAM
from tests.program.campaign import SCENE, Run, shards_of

EVERYTHING = "*.h5"  # samples and processes
NUMBERS_OF_RANKS = (0, 0, 0, 1, 2, 3, 4)  # 0: without mpirun
UNTHREADED = {name: text for name, text in ENVIRONMENT.items() if not name.endswith("_NUM_THREADS")}
WAYS = ("kill the launcher", "kill a rank", "kill everything", "ask a rank", "ask the launcher")


class Torture:
    """One campaign that is killed a number of times and then completed."""

    def __init__(self, program: Path, folder: Path, seed: int) -> None:
        self.program, self.folder = program, folder
        self.random = random.Random(seed)
        self.output = folder / "torture.h5"
        (folder / "torture.nml").write_text(SCENE)
        self.kills = self.plain_kills = self.rounds = 0
        began = time.monotonic()
        code, _, errors = self.start("reference.h5", 2).wait()
        assert code == 0, errors
        self.duration = time.monotonic() - began
        self.reference = scene_bits(folder / "reference.h5")

    def start(self, output: str, n_ranks: int) -> Run:
        arguments = ["run", "torture.nml", "--output", output]
        return Run(self.program, arguments, self.folder, UNTHREADED, n_ranks)

    def interrupt(self, run: Run, way: str) -> None:
        if way == "kill the launcher":
            run.signal(signal.SIGKILL, [run.process.pid])
        elif way == "kill a rank":
            run.signal(signal.SIGKILL, self.random.sample(run.ranks(), 1) if run.ranks() else [])
        elif way == "kill everything":
            run.signal(signal.SIGKILL, [run.process.pid, *run.ranks()])
        elif way == "ask a rank":
            number = self.random.choice([signal.SIGTERM, signal.SIGINT, signal.SIGUSR1])
            run.signal(number, self.random.sample(run.ranks(), 1) if run.ranks() else [])
        else:
            run.signal(signal.SIGUSR1, [run.process.pid])

    def one_run(self) -> None:
        """Starts a run, interrupts it at a random instant, and checks the files that it left."""
        before = shards_of(self.output, EVERYTHING)
        n_ranks = self.random.choice(NUMBERS_OF_RANKS)
        way = self.random.choice(WAYS)
        run = self.start(self.output.name, n_ranks)
        pause = self.random.uniform(0.0, 0.7 * self.duration)
        limit = time.monotonic() + pause
        while time.monotonic() < limit and run.process.poll() is None:
            time.sleep(0.002)
        was_alive = run.process.poll() is None
        if was_alive:
            self.interrupt(run, way)
            self.kills += 1
            self.plain_kills += n_ranks == 0
        code, _, errors = run.wait()
        told = f"{way}, {n_ranks} ranks, after {pause:.3f} s: code {code}\n{errors}"
        if self.output.exists():
            assert scene_bits(self.output) == self.reference, told
        if code == 0:
            assert self.output.exists(), told
            assert not Path(f"{self.output}.shards").exists(), told
            assert not list(self.folder.glob("*.part-*")), told
            self.output.unlink()
            self.rounds += 1
            return
        assert was_alive, told
        after = shards_of(self.output, EVERYTHING)
        if not self.output.exists():
            assert before.items() <= after.items(), f"finished work was lost or redone: {told}"

    def go_on(self, kills: int) -> None:
        while self.kills < kills:
            before = self.kills
            self.one_run()
            if self.kills > before and self.kills % 10 == 0:
                print(f"{self.kills} of {kills} kills, {self.rounds} campaigns", flush=True)
        code, _, errors = self.start(self.output.name, 0).wait()
        assert code == 0, errors
        assert scene_bits(self.output) == self.reference
        assert not Path(f"{self.output}.shards").exists()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--program", type=Path, default=PROGRAM)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp())
    began = time.monotonic()
    torture = Torture(options.program.resolve(), folder, options.seed)
    torture.go_on(options.kills)
    shutil.rmtree(folder)
    print(
        f"{torture.kills} kills (seed {options.seed}), {torture.plain_kills} of them without "
        f"mpirun; {torture.rounds + 1} complete campaigns, "
        f"each the same bits; {time.monotonic() - began:.0f} s"
    )


if __name__ == "__main__":
    main()
