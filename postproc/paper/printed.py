"""The paper's printed numbers, to be set beside ours."""

from __future__ import annotations

from ..results import Results

STUCK_HZ = (1.15, 1.31, 1.53, 1.75, 1.90)  # Table 1
SLIP_HZ = (0.23, 0.66, 1.04, 1.34, 1.53)  # Table 1
SLIP_PERCENT = {  # Table 2, by variance of the excitation
    3.7: (7, 8, 12, 22, 37),
    41.1: (36, 45, 52, 59, 65),
}
WHITE_NOISE = "(1 + ln 2π)/2 = 1.4189385"  # Eq. 42, a point, at std 1
ORDER_OF_FIG_4 = 6  # "L0 = 0.3 and L1 at most 1 leads to M = 6"
PEAK_MEAN = "about 30"  # [%], of the scatter of the time in slip
STDS = (0.067, 0.10)  # of the friction coefficients
LENGTHS = (0.3, 1.0, 3.0)  # L0 of the friction coefficients
PERCENTILES = (5.0, 95.0)  # of the spectra over samples [%]
GIVEN = {  # Sec. 3: what the paper prescribes
    "mass [kg]": "1", "k1 [N/m]": "25", "k2 [N/m]": "50", "N [N]": "10",
    "friction coefficient, mean": "0.2", "modal damping, stuck": "0.005",
    "time step [s]": "0.00843", "steps": "400,000", "samples of a case": "100",
}  # fmt: skip
NYQUIST_OVER_PI = 120  # Eq. 46 [1/s]
LEVELS = {3.7: "low", 41.1: "high"}  # the paper's names of its two variances


def is_paper_chain(n_dof: int, frequencies_stuck: list[float]) -> bool:
    """True if Tables 1 and 2 speak of this chain: the stuck frequencies at printed digits."""
    return n_dof == len(STUCK_HZ) and all(
        abs(ours - theirs) <= 0.006
        for ours, theirs in zip(frequencies_stuck, STUCK_HZ, strict=True)
    )


def is_paper_study(results: Results) -> bool:
    """True if the paper's figures, tables and statements speak of this file.

    Of a chain: the paper's, with the force on the last mass; of processes alone: Sec. 2's.
    """
    if results.structure is None:
        lengths = {float(p.attrs["correlation_length"]) for p in results.processes.values()}
        stds = {float(p.attrs["std"]) for p in results.processes.values()}
        return lengths <= set(LENGTHS) and stds == {1.0}
    n_dof = results.structure.sizes["mode"]
    return results.forced_dof == n_dof and is_paper_chain(
        n_dof, results.structure["frequencies_stuck"].values.tolist()
    )


# The paper's key observations (Sec. 4) and findings (Sec. 3), and which statements are theirs.
OBSERVATIONS = (
    (
        "key observation (i)",
        "The standard deviation of the time in slip peaks at an intermediate value of its mean.",
        ("1a",),
    ),
    (
        "key observation (ii)",
        "The width of the band of uncertainty decreases with the mean time in slip.",
        ("3a",),
    ),
    (
        "key observation (iii)",
        "The correlation length has a definite effect on the width of the bands, clear at high"
        " fractions: largest at intermediate or high lengths, by the level of uncertainty.",
        ("4a", "4b", "4c"),
    ),
    (
        "Sec. 3 (i)",
        "The width falls monotonically with the time in slip, and so with the excitation.",
        ("3b", "6b"),
    ),
    (
        "Sec. 3 (ii)",
        "At high fractions the width is largest at L0 = 1 for the larger uncertainty and at L0 = 3"
        " for the smaller.",
        ("4b", "4c"),
    ),
)

# Ranges of axes by the text of the paper: the force has power up to 2.5 Hz, and panels compared.
# (xmin, xmax, ymin, ymax), by the start of a figure's name.
AXES = {
    "fig_03": (0.0, 20.0, 1.0, 1.45),
    "fig_08": (0.0, 2.5, 1.0e-7, 1.0e1),
    "fig_09": (0.0, 80.0, 0.0, 25.0),
    "fig_10": (0.0, 2.5, 1.0e-7, 1.0e1),
    "fig_11": (0.0, 80.0, 1.0, 50.0),
}
