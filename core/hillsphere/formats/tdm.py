"""CCSDS Tracking Data Messages: what they hold.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020.
"""

from __future__ import annotations

from hillsphere.formats.tdm_segments import Series, TdmHeader, TdmMeta, TdmSegment, angle_series

__all__ = ["Series", "TdmHeader", "TdmMeta", "TdmSegment", "angle_series"]
