"""What a recording, its mapping or its labels are refused for.

::

    FormatError (a ValueError)
    ├── UnknownFormat        no reader is for the file; names all that there are
    ├── NotRead              a format known by name that no reader is for; says what to export instead
    ├── Unreadable           damaged, or not what it says it is: file, place in it, reason
    ├── UndeclaredGeometry   neither file nor caller says the length unit or the up axis, or they contradict
    ├── InvalidMapping       says which field of the mapping, and what it needs
    │   └── UnknownTrack     there is no track of that name; names the nearest
    ├── InvalidLabels        says which row, and why
    └── ReaderStopped        a reader in a process of its own crashed or went over a limit

Their arguments are strings, all of them: an error goes over a pipe as its name and these.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches


class FormatError(ValueError):
    """A recording, or what is said of one, cannot be used."""


class UnknownFormat(FormatError):
    """No reader is for the file."""


class NotRead(FormatError):
    """A format known by name that no reader is for."""


class Unreadable(FormatError):
    """A file, at a place in it, is not what its format asks for."""

    def __init__(self, place: str, reason: str, file: str = "") -> None:
        super().__init__(place, reason, file)
        self.place, self.reason, self.file = place, reason, file

    def __str__(self) -> str:
        return ": ".join(part for part in (self.file, self.place, self.reason) if part)


class UndeclaredGeometry(FormatError):
    """What the numbers mean is said by nobody, or by file and caller differently."""

    def __init__(self, field: str, detail: str) -> None:
        super().__init__(field, detail)
        self.field, self.detail = field, detail

    def __str__(self) -> str:
        return self.detail


class InvalidMapping(FormatError):
    """A mapping is not of the form, or joins what does not belong together."""

    def __init__(self, field: str, detail: str) -> None:
        super().__init__(field, detail)
        self.field, self.detail = field, detail

    def __str__(self) -> str:
        return f"{self.field}: {self.detail}" if self.field else self.detail


class UnknownTrack(InvalidMapping):
    """A mapping names a track that the recording does not have."""

    @classmethod
    def named(cls, field: str, name: str, tracks: Iterable[str]) -> UnknownTrack:
        """Return the error that names the tracks nearest to a name."""
        names = list(tracks)
        by_folded = {track.casefold(): track for track in names}
        near = [by_folded[match] for match in get_close_matches(name.casefold(), by_folded, 3, 0.5)]
        listed = ", ".join(repr(track) for track in near or names[:10])
        more = "" if near or len(names) <= 10 else f" and {len(names) - 10} more"
        hint = "nearest" if near else "there are"
        return cls(field, f"there is no track {name!r}; {hint}: {listed}{more}")


class InvalidLabels(FormatError):
    """A label cannot be read, or lies outside the recording."""

    def __init__(self, row: str, reason: str) -> None:
        super().__init__(row, reason)
        self.row, self.reason = row, reason

    def __str__(self) -> str:
        return f"{self.row}: {self.reason}" if self.row else self.reason


class ReaderStopped(FormatError):
    """A reader in a process of its own crashed or went over a limit."""


@contextmanager
def read_by(library: str) -> Iterator[None]:
    """Call what a library makes of a damaged file, whatever it is, Unreadable. Lack of memory stays that."""
    try:
        yield
    except (FormatError, MemoryError):
        raise
    except Exception as error:
        raise Unreadable("", f"{library} cannot read it: {error or type(error).__name__}") from error
