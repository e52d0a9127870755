"""A campaign on very many ranks: a simulation of its scheduler, and its storage.

    cmake --build --preset release --target benchmarks
    python bench/scheduling.py build/release/bin/bench_storage

Ranks claim blocks of samples from a counter in the root's memory, one atomic operation each, and
keep every block as a shard; in the end the ranks share the percentiles, and the root makes one
file of all shards. The costs of shards are measured here and now (CPU time; a shared file system
adds its own), those of a claim are given. Needs only Python.
"""

import argparse
import heapq
import random
import subprocess

BLOCK = 32  # samples marched together, and in a shard
N_DOF, N_FREQUENCIES, N_BAND = 5, 1025, 61
GROUP = 2**14  # samples sorted together: what a rank holds of the spectra does not grow beyond
SPECTRA = 8 * N_DOF * N_FREQUENCIES  # bytes of a sample, by far the most of it


def simulate(
    n_ranks: int, n_blocks: int, block: float, spread: float, claim: float, seed: int
) -> tuple[float, float]:
    """Efficiency, and the longest wait for a claim [s].

    Blocks take `block` s times a normal factor of the given spread; ranks differ in speed by the
    same spread; the counter serves one claim after the other, `claim` s each.
    """
    draw = random.Random(seed)
    speed = [max(0.3, draw.gauss(1.0, spread)) for _ in range(n_ranks)]
    ready = [(0.0, rank) for rank in range(n_ranks)]
    free_at = queue = busy = end = 0.0
    taken = 0
    while ready:
        now, rank = heapq.heappop(ready)
        served = max(now, free_at) + claim
        queue = max(queue, served - now)
        free_at = served
        if taken == n_blocks:
            end = served
            continue
        taken += 1
        work = block * max(0.3, draw.gauss(1.0, spread)) / speed[rank]
        busy += work
        heapq.heappush(ready, (served + work, rank))
    return busy / (n_ranks * end), queue


def measured(program: str) -> dict[str, float]:
    """Seconds of CPU time a shard, by the name of the work."""
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    words = [line.split() for line in done.stdout.splitlines()]
    return {name: float(milliseconds) * 1e-3 for name, milliseconds, *_ in words}


def main() -> None:
    """Measures, simulates, and prints two tables and what limits them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("--ns", type=float, default=25.0, help="of a sample-step on one core")
    parser.add_argument("--steps", type=int, default=400_000)
    parser.add_argument("--spread", type=float, default=0.2, help="of blocks and of ranks")
    options = parser.parse_args()
    cost = measured(options.program)
    block = BLOCK * options.steps * options.ns * 1e-9 + cost["write_shard"]
    print("CPU time of a shard:", ", ".join(f"{k} {1e3 * v:.2f} ms" for k, v in cost.items()))
    print(f"a block of {BLOCK} samples: {block:.3f} s\n")

    print(
        f"{'ranks':>6} {'samples':>9} {'blocks each':>12} {'claim':>8} {'efficiency':>11} "
        f"{'longest wait':>13} {'march':>9}"
    )
    sizes = ((2, 1200), (100, 10_000), (100, 1_000_000), (1000, 1_000_000), (10_000, 1_000_000))
    for n_ranks, n_samples in sizes:
        n_blocks = -(-n_samples // BLOCK)
        # remote memory access; over TCP the root answers between two pieces of its march
        for claim in (2e-6, 100e-6):
            efficiency, queue = simulate(n_ranks, n_blocks, block, options.spread, claim, seed=1)
            march = n_blocks * block / (n_ranks * efficiency)
            print(
                f"{n_ranks:6d} {n_samples:9d} {n_blocks / n_ranks:12.1f} {1e6 * claim:5.0f} us "
                f"{efficiency:11.3f} {1e3 * queue:10.1f} ms {march:7.1f} s"
            )

    print("\nThe merge, and what a rank holds of the spectra")
    print(f"{'samples':>9} {'shards':>7} {'on disk':>9} {'1 rank':>9} {'17 ranks':>9} {'held':>9}")
    for n_samples in (1200, 10_000, 100_000, 1_000_000):
        shards = -(-n_samples // BLOCK)
        size = n_samples * SPECTRA
        bands = -(-N_FREQUENCIES // N_BAND)
        # ranges of frequencies, shared; small data; every shard into the file; reading that back
        shared = shards * bands * cost["read_band"]
        alone = shards * (cost["read_samples"] + 2 * cost["verify_shard"] + cost["write_shard"])
        held = 8 * N_DOF * N_BAND * min(n_samples, GROUP)
        print(
            f"{n_samples:9d} {shards:7d} {size / 1e9:6.2f} GB {alone + shared:7.1f} s "
            f"{alone + shared / bands:7.1f} s {held / 1e6:6.0f} MB"
        )
    print(
        "\nLimits: some ten blocks a rank are needed to even out what differs between blocks and "
        "ranks;\nthe file is written, and read back, by the root alone. Sorting comes on top."
    )


if __name__ == "__main__":
    main()
