"""The structured singular value µ: bounds, certified over frequency, worst cases, sensitivities.

A loop is M closed by an uncertainty Δ of some blocks (`blocks`). What is asked of it:

- of one complex matrix: `upper_bound.upper_bound`, `lower_bound.lower_bound` and
  `sensitivities.sensitivities`, the blocks' shares;
- of a stable system, at all frequencies: `certified.certified_peak` and, with a perturbation that
  proves the lower bound, `robustness.robust_stability` and `robustness.robust_performance`;
- the largest gain under perturbations of a given size: `worst_case_gain.worst_case_gain`;
- a perturbation as real values and as a stable system, checked in the closed loop:
  `worst_case.worst_case`;
- for plots: `robustness.mu_bounds_on_grid`.
"""
