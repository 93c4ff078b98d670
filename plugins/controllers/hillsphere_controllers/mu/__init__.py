"""The structured singular value µ: bounds, certified over frequency, worst cases, sensitivities.

A system M is closed by an uncertainty Δ with a block structure (`blocks`). The questions about it,
and the functions that answer them:

- of one complex matrix: `upper_bound.upper_bound`, `lower_bound.lower_bound` and
  `sensitivities.sensitivities`, the blocks' shares;
- of a stable system, at all frequencies: `certified.certified_peak` and, with a perturbation that
  proves the lower bound, `robustness.robust_stability` and `robustness.robust_performance`;
- the worst-case gain, the largest one under perturbations of a given size:
  `worst_case_gain.worst_case_gain`;
- a perturbation as real values and as a stable system, checked in the closed loop:
  `worst_case.worst_case`;
- for plots: `robustness.mu_bounds_on_grid`.
"""
