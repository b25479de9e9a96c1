"""What the registry refuses.

::

    RegistryError
    ├── NotFound            there is no such thing; names its kind and itself
    ├── AlreadyExists       the name is taken
    ├── PreconditionFailed  it was changed since the caller looked (If-Match)
    ├── InvalidName         no name for a thing of this kind
    ├── InvalidPageToken    a page token that this listing did not give out
    ├── KeyReused           an idempotency key that came with another request before
    ├── JobTakenOver        another worker has taken the job on since
    ├── OutOfOrder          frames or events that do not go on where a session's durable ones end
    ├── TakenOn             another process has taken the session on since
    ├── InvalidUrl          a database or store that Gesta cannot open
    ├── Unavailable         it cannot be reached, or takes nothing, at the moment: try again
    │   ├── DatabaseUnavailable
    │   └── StoreUnavailable
    ├── ArtifactMissing     nothing in the store has this digest
    ├── ArtifactAltered     what the store holds is not what was put there
    ├── ArtifactInvalid     bytes that are no artifact; names the field
    ├── BackupInvalid       a file that is no backup, not a whole one, or not one for this database
    └── NotEmpty            a database that a backup cannot be restored to: there is something in it
"""

from __future__ import annotations


class RegistryError(Exception):
    """Root of everything that the registry refuses."""


class NotFound(RegistryError):
    """There is no such thing. ``kind`` is a word of the glossary, such as ``version``."""

    def __init__(self, kind: str, name: str) -> None:
        self.kind = kind
        self.name = name
        super().__init__(f"no {kind} {name!r}")


class AlreadyExists(RegistryError):
    """The name is taken by another thing of its kind."""

    def __init__(self, kind: str, name: str) -> None:
        self.kind = kind
        self.name = name
        super().__init__(f"there is a {kind} {name!r} already")


class PreconditionFailed(RegistryError):
    """The thing was changed since the caller looked at it."""

    def __init__(self, kind: str, name: str) -> None:
        self.kind = kind
        self.name = name
        super().__init__(f"{kind} {name!r} is no longer what If-Match names")


class InvalidName(RegistryError):
    """No name for a thing of this kind."""

    def __init__(self, kind: str, name: str, detail: str) -> None:
        self.kind = kind
        self.name = name
        super().__init__(f"{name!r} cannot name a {kind}: {detail}")


class InvalidPageToken(RegistryError):
    """A page token that this listing did not give out."""

    def __init__(self) -> None:
        super().__init__("the page token is not one that this listing gave out")


class KeyReused(RegistryError):
    """An idempotency key that came with another request before."""

    def __init__(self, key: str) -> None:
        self.key = key
        super().__init__(f"idempotency key {key!r} came with another request before")


class JobTakenOver(RegistryError):
    """Another worker has taken the job on since; what this one says of it counts no more."""

    def __init__(self, job_id: str) -> None:
        self.job_id = job_id
        super().__init__(f"job {job_id!r} was taken over by another worker")


class OutOfOrder(RegistryError):
    """Frames or events that do not go on where a session's durable ones end; ``what`` says which."""

    def __init__(self, session_id: str, what: str, expected: int, got: int) -> None:
        self.session_id = session_id
        self.what = what
        self.expected = expected
        self.got = got
        super().__init__(f"session {session_id}: {what} {got} came where {expected} is next")


class TakenOn(RegistryError):
    """Another process has taken the session on since: this one may write to it no more."""

    def __init__(self, session_id: str) -> None:
        self.session_id = session_id
        super().__init__(f"session {session_id} was taken on by another process")


class InvalidUrl(RegistryError):
    """A database or a store that Gesta cannot open."""


class Unavailable(RegistryError):
    """What is kept cannot be reached, or takes nothing, at the moment."""


class DatabaseUnavailable(Unavailable):
    """The database does not answer, or takes nothing."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__("the database cannot be used at the moment")


class StoreUnavailable(Unavailable):
    """The store does not answer, or takes nothing."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__("the store cannot be used at the moment")


class ArtifactMissing(RegistryError):
    """Nothing in the store has this digest; ``of`` names what had it, such as a version."""

    def __init__(self, digest: str, of: str = "") -> None:
        self.digest = digest
        self.of = of
        super().__init__(
            f"{of}: the store does not hold {digest}" if of else f"the store does not hold {digest}"
        )


class ArtifactAltered(RegistryError):
    """What the store holds under this digest is not what was put there; ``of`` names what had it."""

    def __init__(self, digest: str, of: str = "") -> None:
        self.digest = digest
        self.of = of
        super().__init__(
            f"{of}: the store's {digest} was altered" if of else f"the store's {digest} was altered"
        )


class ArtifactInvalid(RegistryError):
    """Bytes that are no artifact; ``field`` names the place, such as ``actions[0].means``."""

    def __init__(self, field: str, detail: str) -> None:
        self.field = field
        self.detail = detail
        super().__init__(f"{field}: {detail}" if field else detail)


class BackupInvalid(RegistryError):
    """A file that is no backup, not a whole one, or not one for this database."""

    def __init__(self, path: str, detail: str) -> None:
        self.path = path
        self.detail = detail
        super().__init__(f"{path}: {detail}")


class NotEmpty(RegistryError):
    """A database that a backup cannot be restored to; ``what`` is in it already."""

    def __init__(self, what: str) -> None:
        self.what = what
        super().__init__(f"the database has {what} already; a backup is restored to an empty one")
