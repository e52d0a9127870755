"""What the paper printed, to be set beside ours."""

from __future__ import annotations

STUCK_HZ = (1.15, 1.31, 1.53, 1.75, 1.90)  # Table 1
SLIP_HZ = (0.23, 0.66, 1.04, 1.34, 1.53)  # Table 1
SLIP_PERCENT = {  # Table 2, by variance of the excitation
    3.7: (7, 8, 12, 22, 37),
    41.1: (36, 45, 52, 59, 65),
}
STDS = (0.067, 0.10)  # of the friction coefficients
LENGTHS = (0.3, 1.0, 3.0)  # L0 of the friction coefficients
LEVELS = {3.7: "low", 41.1: "high"}  # the paper's names of its two variances


def is_paper_chain(n_dof: int, frequencies_stuck: list[float]) -> bool:
    """Whether Tables 1 and 2 speak of this chain: the stuck frequencies at printed digits."""
    return n_dof == len(STUCK_HZ) and all(
        abs(ours - theirs) <= 0.006
        for ours, theirs in zip(frequencies_stuck, STUCK_HZ, strict=True)
    )
