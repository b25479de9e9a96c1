"""In which form an answer is given: the ``Accept`` header, by media type and profile (RFC 9110, 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self
from urllib.request import parse_http_list

from starlette.exceptions import HTTPException


class Form(NamedTuple):
    """A form that an answer can have; profile: which JSON it is, empty for the server's own."""

    media_type: str
    profile: str = ""

    def __str__(self) -> str:
        """Return it as it stands in a header."""
        return f'{self.media_type};profile="{self.profile}"' if self.profile else self.media_type


def choose(accept: str, forms: Sequence[Form]) -> Form:
    """Return the form that is wanted most, the first of those wanted alike.

    Raises HTTPException (406) where none is wanted; it names all that there are.
    """
    ranges = [_Range.of(item) for item in parse_http_list(accept)] or [_Range("*/*")]
    wanted = [(_quality(form, ranges), -at) for at, form in enumerate(forms)]
    quality, at = max(wanted)
    if quality <= 0.0:
        raise HTTPException(406, f"there is {', '.join(map(str, forms))}; not {accept[:200]}")
    return forms[-at]


class _Range(NamedTuple):
    """A part of the header; one that cannot be read is not wanted."""

    kind: str
    profile: str = ""
    quality: float = 1.0

    @classmethod
    def of(cls, item: str) -> Self:
        kind, *parameters = (part.strip() for part in item.split(";"))
        pairs = (parameter.partition("=") for parameter in parameters)
        named = {name.strip().lower(): value.strip().strip('"') for name, _, value in pairs}
        try:
            quality = float(named.get("q", "1"))
        except ValueError:
            quality = 0.0
        return cls(kind.lower(), named.get("profile", ""), quality)

    def fits(self, form: Form) -> bool:
        """Return whether a form is in the range; one with a profile has to be named with it."""
        if self.kind in ("*/*", f"{form.media_type.partition('/')[0]}/*"):
            return not form.profile
        return self.kind == form.media_type and self.profile == form.profile


def _quality(form: Form, ranges: Sequence[_Range]) -> float:
    """Return the quality that the most specific range gives a form."""
    fitting = [(-each.kind.count("*"), each.quality) for each in ranges if each.fits(form)]
    return max(fitting, default=(0, 0.0))[1]
