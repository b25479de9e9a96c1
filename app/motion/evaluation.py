"""How well found segments agree with the truth, pooled over recordings.

Segments without an action are no actions: in the truth they are rest, among the found no detection.

- **delineated**: both ends within ``TOLERANCE`` of the truth, or inside the rest beside it;
- **F1@k**: of segments of the same class whose intersection over union is at least k, one to one;
- **frame accuracy**: over the frames of true actions; an action found in rest counts apart;
- **boundary error**: at both ends of segments of the same class with intersection over union above 0.5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.motion.errors import InvalidSegment
from app.motion.trajectory import Flags, Floats, Segment

TOLERANCE = 0.15
"""How far an end of a delineated segment may lie from the truth [s]."""

_SLACK = 1e-6  # the rounding of times and of their ratios decides nothing

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Measures:
    """Shares lie in 0..1; None where there is nothing to share out."""

    n_true: int
    n_found: int
    delineated: float | None
    classified_of_delineated: float | None
    f1_50: float | None
    f1_75: float | None
    frame_accuracy: float | None


@dataclass(frozen=True)
class Evaluation(Measures):
    """The measures over all classes, and those of each class.

    n_extra: found segments that match no true one at 0.5, whatever the class; action_in_rest: share of the
    frames of rest in which an action was found; confusion: true segments (rows) against found ones
    (columns) that match at 0.5, counted in the order of per_class; the last row holds the extra segments,
    the last column the missed ones.
    """

    n_extra: int
    action_in_rest: float | None
    median_boundary_error_ms: float | None
    per_class: Mapping[str, Measures]
    confusion: tuple[tuple[int, ...], ...]


def evaluate(recordings: Sequence[tuple[Floats, Sequence[Segment], Sequence[Segment]]]) -> Evaluation:
    """Return the measures over recordings, each given as (times (n_frames,) [s], truth, found).

    True segments do not overlap. Raises InvalidSegment for a segment outside its recording.
    """
    segments = [segment for _, truth, found in recordings for segment in (*truth, *found)]
    actions = sorted({segment.action for segment in segments if segment.action is not None})
    tables = [_tabulate(times, truth, found, actions) for times, truth, found in recordings]
    nothing = _tabulate(np.zeros(0), (), (), actions)
    table = _Table(*map(np.concatenate, zip(nothing, *tables, strict=True)))
    confusion = _confusion(table, len(actions))
    return Evaluation(
        **vars(_measures(table, table.true >= 0, table.found >= 0)),
        n_extra=int(confusion[-1].sum()),
        action_in_rest=_share(table.acted.sum(), table.rest.sum()),
        median_boundary_error_ms=1000.0 * float(np.median(table.errors)) if len(table.errors) else None,
        per_class={
            action: _measures(table, table.true == index, table.found == index)
            for index, action in enumerate(actions)
        },
        confusion=tuple(tuple(row) for row in confusion.tolist()),
    )


class _Spans(NamedTuple):
    """Labelled stretches of time: frames and times [s] of their starts and ends, and their classes."""

    first: Counts
    last: Counts
    start: Floats
    end: Floats
    classes: Counts


class _Table(NamedTuple):
    """What is counted in one recording, or in several.

    Per true segment its class, the class found where it is delineated and where segments match at 0.5
    (-1 for none), whether it has a match of its class at 0.5 and 0.75, its frames and those found right;
    per found segment its class; per matched end its error [s]; per recording its frames of rest and those
    in which an action was found.
    """

    true: Counts
    delineated: Counts
    overlapped: Counts
    matched_50: Flags
    matched_75: Flags
    frames: Counts
    right: Counts
    found: Counts
    errors: Floats
    rest: Counts
    acted: Counts


def _tabulate(
    times: Floats, truth: Sequence[Segment], found: Sequence[Segment], actions: Sequence[str]
) -> _Table:
    true, seen = _spans(times, truth, actions), _spans(times, found, actions)
    rows, columns, iou = _overlaps(true, seen)
    same = true.classes[rows] == seen.classes[columns]

    def match(allowed: Flags) -> Counts:
        return _matching(rows[allowed], columns[allowed], len(true.classes), len(seen.classes))

    classes = np.append(seen.classes, -1)  # so that no match, -1, has class -1
    close = same & (iou > 0.5 + _SLACK)
    true_at, seen_at = _painted(true, len(times)), _painted(seen, len(times))
    errors = [abs(getattr(true, at)[rows] - getattr(seen, at)[columns])[close] for at in ("start", "end")]
    return _Table(
        true=true.classes,
        delineated=classes[
            _matching(*_delineations(true, seen, times), len(true.classes), len(seen.classes))
        ],
        overlapped=classes[match(np.ones_like(same))],
        matched_50=match(same) >= 0,
        matched_75=match(same & (iou >= 0.75 - _SLACK)) >= 0,
        frames=true.last - true.first,
        right=np.array(
            [np.sum(seen_at[a:b] == c) for a, b, c in zip(true.first, true.last, true.classes, strict=True)],
            dtype=np.int64,
        ),
        found=seen.classes,
        errors=np.concatenate(errors),
        rest=np.array([np.sum(true_at < 0)]),
        acted=np.array([np.sum((true_at < 0) & (seen_at >= 0))]),
    )


def _spans(times: Floats, segments: Sequence[Segment], actions: Sequence[str]) -> _Spans:
    for index, segment in enumerate(segments):
        if not 0 <= segment.start < segment.end <= len(times):
            raise InvalidSegment(
                index,
                f"[{segment.start}, {segment.end}) must start before its end and lie within the "
                f"{len(times)} frames",
            )
    labelled = sorted((s for s in segments if s.action is not None), key=lambda s: (s.start, s.end))
    first = np.array([s.start for s in labelled], dtype=np.int64)
    last = np.array([s.end for s in labelled], dtype=np.int64)
    classes = np.array([actions.index(s.action) for s in labelled if s.action], dtype=np.int64)
    return _Spans(first, last, times[first], times[np.minimum(last, len(times) - 1)], classes)


def _overlaps(true: _Spans, seen: _Spans) -> tuple[Counts, Counts, Floats]:
    """Return the pairs (true, found) whose intersection over union is at least 0.5, and what it is."""
    rows, columns, ious = [], [], []
    for row, (start, end) in enumerate(zip(true.start, true.end, strict=True)):
        shared = np.minimum(end, seen.end) - np.maximum(start, seen.start)
        union = np.maximum(end, seen.end) - np.minimum(start, seen.start)
        iou = shared / np.maximum(union, _SLACK)
        near = np.flatnonzero(iou >= 0.5 - _SLACK)
        rows.append(np.full(len(near), row))
        columns.append(near)
        ious.append(iou[near])
    return _joined(rows), _joined(columns), np.concatenate([np.zeros(0), *ious])


def _delineations(true: _Spans, seen: _Spans, times: Floats) -> tuple[Counts, Counts]:
    """Return the pairs (true, found) of which the found one delineates the true one."""
    earliest = np.concatenate([times[:1], true.end])
    latest = np.concatenate([true.start[1:], times[-1:]])
    rows, columns = [], []
    for row, (start, end) in enumerate(zip(true.start, true.end, strict=True)):
        low, high = min(earliest[row], start - TOLERANCE), max(latest[row], end + TOLERANCE)
        starts = (seen.start >= low - _SLACK) & (seen.start <= start + TOLERANCE + _SLACK)
        ends = (seen.end >= end - TOLERANCE - _SLACK) & (seen.end <= high + _SLACK)
        columns.append(np.flatnonzero(starts & ends))
        rows.append(np.full(len(columns[-1]), row))
    return _joined(rows), _joined(columns)


def _joined(parts: Sequence[Counts]) -> Counts:
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def _matching(rows: Counts, columns: Counts, n_true: int, n_found: int) -> Counts:
    """Return for each true segment the found one it is paired with, -1 for none: as many as can be."""
    from scipy.sparse import csr_array  # noqa: PLC0415 (a server that only recognises has no use for it)
    from scipy.sparse.csgraph import maximum_bipartite_matching  # noqa: PLC0415

    allowed = csr_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(n_true, n_found))
    return np.asarray(maximum_bipartite_matching(allowed, perm_type="column"), dtype=np.int64)


def _painted(spans: _Spans, n_frames: int) -> Counts:
    """Return the class at each frame, -1 for none; of overlapping spans the later one's."""
    classes = np.full(n_frames, -1)
    for first, last, index in zip(spans.first, spans.last, spans.classes, strict=True):
        classes[first:last] = index
    return classes


def _measures(table: _Table, true: Flags, found: Flags) -> Measures:
    """Return the measures over some of the true and of the found segments."""
    n_true, n_found = int(true.sum()), int(found.sum())
    delineated = true & (table.delineated >= 0)
    return Measures(
        n_true,
        n_found,
        delineated=_share(delineated.sum(), n_true),
        classified_of_delineated=_share(
            (delineated & (table.delineated == table.true)).sum(), delineated.sum()
        ),
        f1_50=_share(2 * table.matched_50[true].sum(), n_true + n_found),
        f1_75=_share(2 * table.matched_75[true].sum(), n_true + n_found),
        frame_accuracy=_share(table.right[true].sum(), table.frames[true].sum()),
    )


def _share(part: int, whole: int) -> float | None:
    return float(part / whole) if whole else None


def _confusion(table: _Table, n_actions: int) -> Counts:
    """Return the (n_actions + 1, n_actions + 1) counts: true by found, the last row extra, column missed."""
    counts = np.zeros((n_actions + 1, n_actions + 1), dtype=np.int64)
    np.add.at(counts, (table.true, table.overlapped), 1)
    np.add.at(counts[-1], table.found, 1)
    counts[-1] -= counts[:-1].sum(axis=0)
    counts[-1, -1] = 0
    return counts
