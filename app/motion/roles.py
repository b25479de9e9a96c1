"""Which object fills which role.

A model speaks of roles, a stream of objects. An object named like a role fills it; for the other roles
every choice of the other objects is a *filling* of its own, and the recogniser finds the best.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice, permutations

import numpy as np

from app.motion.errors import InvalidRequest, RoleMissing
from app.motion.trajectory import Indices

MAX_FILLINGS = 64
"""Each filling costs as much again: with more than so many, name the objects like their roles."""


def fillings(roles: Sequence[str], objects: Sequence[str]) -> Indices:
    """Return the (n_fillings, n_roles) indices of the objects in each role.

    Raises RoleMissing where objects are too few, InvalidRequest where there are more than MAX_FILLINGS.
    """
    open_roles = [role for role in roles if role not in objects]
    free = [name for name in objects if name not in roles]
    if len(free) < len(open_roles):
        raise RoleMissing(open_roles[len(free)], tuple(objects))
    ways = list(islice(permutations(free, len(open_roles)), MAX_FILLINGS + 1))
    if len(ways) > MAX_FILLINGS:
        raise InvalidRequest(
            "objects",
            f"{len(free)} objects can fill {len(open_roles)} roles in more than {MAX_FILLINGS} ways: name "
            f"an object like a role ({', '.join(open_roles)}), or leave some out",
        )
    result = np.zeros((len(ways), len(roles)), dtype=np.int64)
    for index, way in enumerate(ways):
        filler = dict(zip(open_roles, way, strict=True))
        result[index] = [objects.index(filler.get(role, role)) for role in roles]
    return result
