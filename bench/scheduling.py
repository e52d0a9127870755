"""A campaign on very many ranks: a simulation of its march and its merge, with measured costs.

    cmake --build --preset release --target benchmarks
    python bench/scheduling.py build/release/bin/bench_storage

Ranks claim blocks of samples from a counter in the root's memory, one atomic operation each: one
block, or beyond 64 ranks a share of those left, and keep every claim as a shard. In the merge the
ranks share out the spectra by ranges of frequencies and groups of samples, and the joints by groups
of samples; they read both twice where there are several groups. Beside that the root reads what is
small of every sample and writes it. Costs are CPU time here and now; a shared file system
adds its own, and those of a claim are given. Needs only Python.
"""

import argparse
import heapq
import random
import subprocess

BLOCK = 32  # samples marched together
MOST_BLOCK_CLAIMERS = 64  # ranks that claim a block at a time
N_DOF, N_FREQUENCIES, N_BAND = 5, 1025, 61
GROUP = 2**14  # samples sorted together: what a rank holds of the spectra does not grow beyond
SPECTRA = 8 * N_DOF * N_FREQUENCIES  # bytes of a sample, by far the most of it


def claims(n_blocks: int, n_ranks: int) -> list[int]:
    """Blocks of each claim, as campaign_study has them."""
    sizes = []
    while n_blocks > 0:
        sizes.append(max(1, n_blocks // (3 * n_ranks)) if n_ranks > MOST_BLOCK_CLAIMERS else 1)
        n_blocks -= sizes[-1]
    return sizes


def simulate(
    n_ranks: int, sizes: list[int], block: float, shard: float, spread: float, claim: float
) -> tuple[float, float]:
    """End of the march, and the longest wait for a claim [s].

    Blocks take `block` s times a normal factor of the given spread; ranks differ in speed by the
    same spread; a shard takes `shard` s; the counter serves one claim after the other, `claim` s
    each.
    """
    draw = random.Random(1)
    speed = [max(0.3, draw.gauss(1.0, spread)) for _ in range(n_ranks)]
    ready = [(0.0, rank) for rank in range(n_ranks)]
    free_at = queue = end = 0.0
    taken = 0
    while ready:
        now, rank = heapq.heappop(ready)
        served = max(now, free_at) + claim
        queue = max(queue, served - now)
        free_at = served
        if taken == len(sizes):
            end = served
            continue
        n = sizes[taken]
        taken += 1
        work = n * block * max(0.3, draw.gauss(1.0, spread / n**0.5)) + shard
        heapq.heappush(ready, (served + work / speed[rank], rank))
    return end, queue


class Costs:
    """CPU time [s] of the works that bench_storage measures."""

    def __init__(self, program: str) -> None:
        """Runs the program once."""
        done = subprocess.run([program], capture_output=True, text=True, check=True)
        words = [line.split() for line in done.stdout.splitlines()]
        self.of = {name: float(milliseconds) * 1e-3 for name, milliseconds, *_ in words}

    def shard(self, work: str, n_blocks: float) -> float:
        """A work on a shard of so many blocks: a part for the shard, and one for each block."""
        each = (self.of[f"{work}_of_4"] - self.of[work]) / 3
        return self.of[work] + each * (n_blocks - 1)


def merge(cost: Costs, n_ranks: int, n_samples: int, n_shards: int) -> tuple[float, float]:
    """Time of the merge without the samples' spectra, and of copying them into the file [s]."""
    blocks = n_samples / BLOCK / n_shards  # of a shard
    groups = -(-n_samples // GROUP)
    passes = 2 if groups > 1 else 1
    share = n_samples / groups / GROUP
    parts = groups * -(-N_FREQUENCIES // N_BAND)
    part = passes * n_shards / groups * cost.shard("read_part", blocks)
    part += share * (cost.of["spectra_part"] + (passes - 1) * cost.of["selection_part"])
    each = n_shards / groups * cost.shard("read_samples", blocks)
    joints = passes * each + share * (cost.of["joints_group"] + cost.of["spans_group"])
    joints += n_shards / groups * cost.shard("read_part", blocks)  # the slip series, not larger
    joints += (passes - 1) * share * cost.of["joints_selection"]
    root = groups * each
    beside = max(root, -(-(parts + groups) // n_ranks) * max(part, joints))
    verified = -(-n_shards // n_ranks) * cost.shard("read_shard", blocks)
    # read, written, and read back with its checksum
    copied = n_shards * (2 * cost.shard("read_shard", blocks) + cost.shard("write_shard", blocks))
    return verified + beside, copied


def main() -> None:
    """Measures, simulates, and prints a table and what limits it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("--ns", type=float, default=25.0, help="of a sample-step on one core")
    parser.add_argument("--steps", type=int, default=400_000)
    parser.add_argument("--spread", type=float, default=0.2, help="of blocks and of ranks")
    options = parser.parse_args()
    cost = Costs(options.program)
    block = BLOCK * options.steps * options.ns * 1e-9
    print("CPU time:", ", ".join(f"{name} {1e3 * t:.2f} ms" for name, t in cost.of.items()))
    print(f"a block of {BLOCK} samples: {block:.3f} s\n")

    print(
        f"{'ranks':>6} {'samples':>9} {'shards':>7} {'on disk':>9} {'claim':>7} {'wait':>9} "
        f"{'march':>9} {'merge':>9} {'end to end':>11} {'copying':>9}"
    )
    sizes = ((2, 1200), (17, 100_000), (64, 100_000), (100, 100_000), (100, 1_000_000),
             (1000, 1_000_000), (10_000, 1_000_000))  # fmt: skip
    for n_ranks, n_samples in sizes:
        taken = claims(-(-n_samples // BLOCK), n_ranks)
        # remote memory access; over TCP the root answers between two pieces of its march
        for claim in (2e-6, 100e-6):
            shard = cost.shard("write_shard", n_samples / BLOCK / len(taken))
            march, wait = simulate(n_ranks, taken, block, shard, options.spread, claim)
            merged, copied = merge(cost, n_ranks, n_samples, len(taken))
            best = sum(taken) * block / n_ranks
            print(
                f"{n_ranks:6d} {n_samples:9d} {len(taken):7d} {n_samples * SPECTRA / 1e9:6.2f} GB "
                f"{1e6 * claim:4.0f} us {1e3 * wait:6.1f} ms {march:7.1f} s {merged:7.1f} s "
                f"{best / (march + merged):11.2f} {copied:7.1f} s"
            )
    print(
        "\nend to end: march without losses over march and merge, output%samples = .false.\n"
        "copying: what the root adds with output%samples = .true.; nobody can help it"
    )


if __name__ == "__main__":
    main()
