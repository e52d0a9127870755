"""Figures of results files: one function per figure, drawn on the axes that it is given."""

from .harmonic_figures import plot_equivalent, plot_frequency_response, plot_phase
from .process_figures import (
    plot_achieved_lengths,
    plot_autocovariances,
    plot_chosen_orders,
    plot_each,
    plot_entropies,
    plot_positive,
    plot_positive_difference,
    plot_realizations,
)
from .response_figures import plot_history, plot_hysteresis, plot_slider, plot_transition
from .study_figures import (
    plot_along,
    plot_band,
    plot_band_ratio,
    plot_slip_scatter,
    plot_spectra,
    plot_spectra_along,
    plot_sweep,
    plot_sweep_spectra,
)
from .style import apply_style

__all__ = [
    "apply_style", "plot_achieved_lengths", "plot_along", "plot_autocovariances", "plot_band",
    "plot_band_ratio", "plot_chosen_orders", "plot_each", "plot_entropies", "plot_equivalent",
    "plot_frequency_response", "plot_history", "plot_hysteresis", "plot_phase", "plot_positive",
    "plot_positive_difference", "plot_realizations", "plot_slider", "plot_slip_scatter",
    "plot_spectra", "plot_spectra_along", "plot_sweep", "plot_sweep_spectra", "plot_transition",
]  # fmt: skip
