"""Whether what is not stable can be reached and seen."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_controllers.errors import NotStabilisableError

__all__ = ["check_modes"]

_MODE = 1e-9


def check_modes(a: Array, b: Array, c: Array, *, discrete: bool = False) -> None:
    """Check that controls reach and measurements show every mode that is not stable.

    Parameters
    ----------
    a, b, c : ndarray, shape (n, n), (n, m), (p, n)
        Matrices from the controls to the measurements; with no columns in b or no rows in c, that
        side is not looked at.
    discrete : bool
        Whether the stable modes are those inside of the unit circle.

    Raises
    ------
    NotStabilisableError
        Naming the mode, and which side lacks it.
    """
    for value in np.linalg.eigvals(a):
        if abs(value) < 1.0 if discrete else value.real < 0.0:
            continue
        away = a - value * np.eye(len(a))
        for matrix, what, remedy in (
            (np.hstack([away, b]), "the controls do not reach", "an actuator for it"),
            (np.vstack([away, c]).T, "the measurements do not show", "a sensor for it"),
        ):
            if matrix.shape[1] == len(a):
                continue
            values = np.linalg.svd(matrix, compute_uv=False)
            if values[-1] <= _MODE * max(values[0], 1e-300):
                raise NotStabilisableError(
                    f"{what} the mode at {'z' if discrete else 's'} = {value:.6g}, which is not "
                    f"stable; add {remedy}, or take weights with poles on the "
                    f"{'unit circle' if discrete else 'axis'} out of the plant"
                )
