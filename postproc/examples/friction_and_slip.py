"""A worked example: which friction coefficient decides how long an oscillator slips?

    python -m entroslip.examples.friction_and_slip results/paper/paper.h5 --out slip.png

Cells are marked by `# %%`, for editors that run them one by one.
"""

# %% Open the file: labelled arrays, read as they are used.
from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import xarray as xr

from entroslip import figures, open_results
from entroslip.style import apply_style, of_dof

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("results", type=Path)
parser.add_argument("--out", type=Path, default=Path("friction_and_slip.png"))
options = parser.parse_args()
results = open_results(options.results)
print(results.title, "with", len(results.cases), "cases; the groups of the file:")
print(", ".join(results.tree.groups))

# %% One case is an xarray.Dataset; every variable knows its axes, units and meaning.
case = next((case for case in results.random if case.n_samples > 1), None)
if case is None:
    parser.error(f"{options.results}: needs a case of several samples with drawn friction")
slip = case.data["slip_fraction"]
print(f"{case.name}: {slip.attrs['long_name']} over {slip.dims}, shape {slip.shape}")

# %% Labelled arithmetic: mean and standard deviation over samples, with the file's own errors.
summary = xr.Dataset(
    {
        "mean": slip.mean("sample"),
        "std": slip.std("sample", ddof=1),
        "error of the mean": case.data["slip_mean_error"],
    }
)
print(summary.to_dataframe().round(4))

# %% Correlation over samples of the friction at each slider with the slip of each oscillator.
friction = case.data["friction"].rename(joint="slider")
correlation = xr.corr(friction, slip, dim="sample")
print("correlation of friction (rows) and time in slip (columns):")
print(correlation.to_pandas().round(2))

# %% A figure of our own beside one of the package's, on the axes that they are given.
mpl.use("Agg")
apply_style()
picture, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
for joint in range(1, case.n_joints + 1):
    look = of_dof(joint, case.n_joints) | {"linestyle": "none"}
    one = case.data.sel(joint=joint)
    left.plot(one["friction"], one["slip_fraction"], label=f"joint {joint}", **look)
left.set(xlabel="friction coefficient of its slider", ylabel="fraction of time in slip")
left.legend()
figures.plot_slip_scatter(right, [c for c in results.random if c.std == case.std])
picture.savefig(options.out)
print("drawn:", options.out)
