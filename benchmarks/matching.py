"""Which found segment is which true one, whatever their classes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from app.motion.recogniser import SegmentEvent
from app.motion.trajectory import Floats, Segment

LEAST = 0.5
"""Intersection over union from which on two segments are the same."""


def matched(
    times: Floats, truth: Iterable[Segment], found: Sequence[SegmentEvent]
) -> list[SegmentEvent | None]:
    """Return for each true segment the found one that covers most of the same time, None for none.

    times: (n_frames,) [s]. Neither the true ones nor the found ones overlap each other.
    """
    matches: list[SegmentEvent | None] = []
    for segment in truth:
        start, end = float(times[segment.start]), float(times[min(segment.end, len(times) - 1)])
        alike = [(_iou(start, end, each.t_start, each.t_end), index) for index, each in enumerate(found)]
        best, index = max(alike, default=(0.0, -1))
        matches.append(found[index] if best >= LEAST else None)
    return matches


def _iou(start: float, end: float, other_start: float, other_end: float) -> float:
    shared = min(end, other_end) - max(start, other_start)
    return max(shared, 0.0) / (max(end, other_end) - min(start, other_start))
