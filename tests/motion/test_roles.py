"""Which object fills which role: every way there is, each once, the named ones where their name says."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.motion.errors import InvalidRequest, RoleMissing
from app.motion.roles import MAX_FILLINGS, fillings

NAMES = ["cup", "plate", "lid", "jar", "spoon"]


def by_trying_all(roles: list[str], objects: list[str]) -> set[tuple[int, ...]]:
    """Return the fillings among all choices of objects: no object twice, namesakes where they belong."""
    found = set()
    for choice in product(range(len(objects)), repeat=len(roles)):
        named = [objects[at] for at in choice]
        if len(set(choice)) == len(roles) and all(
            name == role if role in objects else name not in roles
            for role, name in zip(roles, named, strict=True)
        ):
            found.add(choice)
    return found


names = st.lists(st.sampled_from(NAMES), unique=True, max_size=4)


@given(names, names)
def test_every_way_is_there_once(roles: list[str], objects: list[str]) -> None:
    wanted = by_trying_all(roles, objects)
    if len(objects) < len(roles) or not wanted:
        with pytest.raises(RoleMissing):
            fillings(roles, objects)
        return
    found = fillings(roles, objects)
    assert found.shape == (len(wanted), len(roles))
    assert set(map(tuple, found.tolist())) == wanted


def test_without_roles_there_is_one_way_whatever_is_there() -> None:
    assert fillings([], NAMES).shape == (1, 0)


def test_the_role_that_nothing_is_left_for_is_named() -> None:
    with pytest.raises(RoleMissing, match="there are plate, box") as raised:
        fillings(["cup", "plate", "lid"], ["plate", "box"])
    assert raised.value.role == "lid"


def test_too_many_ways_are_refused() -> None:
    many = [f"thing {at}" for at in range(MAX_FILLINGS)]
    assert len(fillings(["cup"], many)) == MAX_FILLINGS
    with pytest.raises(InvalidRequest, match=f"more than {MAX_FILLINGS} ways: name an object like a role"):
        fillings(["cup"], [*many, "one more"])
    assert len(fillings(["cup"], [*many, "one more", "cup"])) == 1
