"""What a session says, as the JSON text that goes over the wire. Nothing non-finite goes out: it is null."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from app.motion.hypothesis import Hypothesis
from app.motion.recogniser import SegmentEvent
from app.motion.trajectory import Floats
from app.motion.window import Gap


def as_json(message: dict[str, Any]) -> str:
    """Return the message as compact JSON text."""
    return json.dumps(_finite(message), separators=(",", ":"), allow_nan=False)


def segment(event: SegmentEvent, number: int, model: str, version: int) -> dict[str, Any]:
    """Return the fields of a ``segment``."""
    return {
        "segment": number,
        "start_seq": event.start,
        "end_seq": event.end,
        "t_start": event.t_start,
        "t_end": event.t_end,
        "action": event.action,
        "objects": event.objects,
        "log_likelihoods": event.log_likelihoods,
        "margin": event.margin,
        "novelty": event.novelty,
        "model": model,
        "version": version,
    }


def gap(event: Gap) -> dict[str, Any]:
    """Return the fields of a ``gap``."""
    return {"from_seq": event.start, "to_seq": event.end, "seconds": event.seconds}


def hypothesis(found: Hypothesis) -> str:
    """Return a ``hypothesis`` message; it has ``goals`` where there are candidates, the likely first."""
    ranked = sorted(found.goals.items(), key=lambda goal: -goal[1])
    goals = [{"name": name, "posterior": posterior} for name, posterior in ranked]
    fields = {
        "start_seq": found.start,
        "through_seq": found.through,
        "actions": [
            {"action": each.action, "posterior": each.posterior, "progress": each.progress}
            for each in found.actions
        ],
    }
    return as_json({"type": "hypothesis", **fields} | ({"goals": goals} if goals else {}))


def frame(seq: int, row: Floats, objects: Sequence[str]) -> str:
    """Return a ``frame`` message: row is (1 + 3 n_tracks,), a time [s] and positions [m]."""
    hand, *others = _positions(row)
    fields = {
        "seq": seq,
        "t": float(row[0]),
        "hand": hand,
        "objects": dict(zip(objects, others, strict=True)),
    }
    return as_json({"type": "frame", **fields})


def _positions(row: Floats) -> Iterator[list[float] | None]:
    for position in row[1:].reshape(-1, 3):
        yield None if np.isnan(position).any() else position.tolist()


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
