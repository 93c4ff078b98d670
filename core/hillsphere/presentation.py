"""Presentation of a stage's result: metrics, tables and figures, which are drawn later.

The public names of `hillsphere.show.presentation`.
"""

from hillsphere.show.presentation import (
    PALETTE,
    Cell,
    Column,
    Figure,
    Metric,
    Presentation,
    Printed,
    Table,
    check_presentation,
    presentation_faults,
)

__all__ = [
    "PALETTE",
    "Cell",
    "Column",
    "Figure",
    "Metric",
    "Presentation",
    "Printed",
    "Table",
    "check_presentation",
    "presentation_faults",
]
