"""Which form of an answer an ``Accept`` header means."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.exceptions import HTTPException

from app.api.representations import Form, choose

JSON, PATH, CSV = Form("application/json"), Form("application/json", "nav_msgs/Path"), Form("text/csv")
FORMS = (JSON, PATH, CSV)


@pytest.mark.parametrize(
    ("accept", "form"),
    [
        ("", JSON),
        ("*/*", JSON),
        ("application/*", JSON),
        ("application/json", JSON),
        ("application/json; charset=utf-8", JSON),
        ('application/json;profile="nav_msgs/Path"', PATH),
        ("Application/JSON ; Profile = nav_msgs/Path", PATH),
        ("text/*", CSV),
        ("text/csv, application/json", JSON),
        ("application/json;q=0.5, text/csv", CSV),
        ("*/*;q=0.1, text/csv;q=0.2", CSV),
        ("application/json;q=0, */*", CSV),
        ('text/html, application/json;profile="nav_msgs/Path";q=0.3', PATH),
    ],
)
def test_the_form_that_is_wanted_most_is_given(accept: str, form: Form) -> None:
    assert choose(accept, FORMS) == form


@pytest.mark.parametrize(
    "accept",
    [
        "text/html",
        "text/csv;q=0",
        "*/*;q=0",
        "application/json;q=much",
        "application/json;profile=other",
        ";",
    ],
)
def test_what_there_is_not_is_not_acceptable(accept: str) -> None:
    with pytest.raises(HTTPException, match="text/csv") as refused:
        choose(accept, FORMS)
    assert refused.value.status_code == 406


@given(st.text(max_size=60))
def test_whatever_else_is_wanted_a_form_is_given(accept: str) -> None:
    assert choose(f"{accept.replace(chr(34), '')}, */*;q=0.1", FORMS) in FORMS


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_given_by_its_own_name(form: Form) -> None:
    assert choose(str(form), FORMS) == form
