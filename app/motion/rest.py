"""Where in a segment the hand moves, without the rest beside it: Steps 1-3 know no rest."""

from __future__ import annotations

import numpy as np

from app.motion.trajectory import Floats

LEFT = 0.05
"""Share of its farthest way from an end at which a hand has surely left that end."""

LEFT_AT = 0.1893
"""Share of its duration in which a minimum-jerk movement gets that far: 10 t^3 - 15 t^4 + 6 t^5 = LEFT."""


def movement(hand: Floats) -> tuple[int, int]:
    """Return the first and the last frame of the movement in a segment, neither of them a dropout.

    hand: (n_frames, 3) [m], its first and last frame no dropouts. A hand at rest trembles, and a movement
    begins and ends too slowly to be seen. So both are looked for where the hand has come ``LEFT`` of its
    farthest way from the segment's ends, and set farther out as a minimum-jerk movement would go on, though
    not beyond the segment.
    """
    seen = np.flatnonzero(~np.isnan(hand[:, 0]))
    track = hand[seen]
    from_start, from_end = (np.linalg.norm(track - end, axis=1) for end in (track[0], track[-1]))
    farthest = max(from_start.max(), from_end.max())
    left, not_there = from_start > LEFT * farthest, from_end > LEFT * farthest
    if not left.any() or not not_there.any():
        return 0, len(hand) - 1
    fast = seen[np.flatnonzero(left)[0]], seen[np.flatnonzero(not_there)[-1]]
    slow = max(fast[1] - fast[0], 0) * LEFT_AT / (1.0 - 2.0 * LEFT_AT)
    first = seen[seen <= max(fast[0] - slow, 0)][-1]
    last = seen[seen >= min(fast[1] + slow, len(hand) - 1)][0]
    return (int(first), int(last)) if first < last else (0, len(hand) - 1)
