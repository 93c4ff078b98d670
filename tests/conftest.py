"""What holds for all tests: linear algebra in one thread, and long files first.

As many processes of tests run as there are cores; threads of theirs would only wait for each
other, and they do so busily, which takes several times the time of the work itself.
"""

from __future__ import annotations

import os

import pytest

# Before numpy is imported, which reads them then.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the missions, lest one process be left alone with the last of them."""
    items.sort(key=lambda item: item.path.parent.name != "missions")
