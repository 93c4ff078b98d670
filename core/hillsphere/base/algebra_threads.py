"""Number of threads of linear algebra, which its libraries read when they are loaded."""

from __future__ import annotations

import os
import sys

__all__ = ["ONE_THREAD", "use_one_thread"]

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    ),
    "1",
)
"""Environment of linear algebra in one thread, whose bits depend on no number of them."""


def use_one_thread() -> None:
    """Let the linear algebra of this process work in one thread, unless the user has chosen.

    Matrices of control and estimation have some tens of rows: threads wait for each other longer
    than they compute, and on a busy processor many times as long. Nothing changes if one of the
    variables of `ONE_THREAD` is set, or if numpy is loaded, which reads them then.
    """
    if "numpy" not in sys.modules and not any(name in os.environ for name in ONE_THREAD):
        os.environ.update(ONE_THREAD)
