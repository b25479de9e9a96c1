"""Whom a command asks: a server, and what is told where it refuses or does not answer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from socket import gaierror
from typing import Annotated, Any

import httpx
import typer
from websockets.exceptions import WebSocketException

from app.client import ApiError, GestaClient, GestaError, Message
from app.commands.terminal import failure, job_watched, tell
from app.formats.errors import FormatError

URL = "http://127.0.0.1:8000"

Url = Annotated[str, typer.Option(envvar="GESTA_URL", help="Where the server is.")]
Model = Annotated[str, typer.Argument(help="The name of a model.")]
Version = Annotated[
    str | None, typer.Option(help="A number, an alias or `latest`; default: production, else the latest.")
]

TITLE = "Gesta"
"""Of the documents that a server gives."""
AWAY = (httpx.HTTPError, httpx.InvalidURL, WebSocketException, ConnectionError, TimeoutError, gaierror)


@contextmanager
def asking(url: str) -> Iterator[GestaClient]:
    """Give a client of the server; what goes wrong is told in words, and the command ends with 1."""
    try:
        with GestaClient(url) as client:
            yield client
    except ApiError as error:
        raise failure("\n".join([str(error), *_places(error)])) from error
    except BrokenPipeError:  # of who reads what we tell
        raise
    except AWAY as error:
        raise failure(f"{url} does not answer: {error}") from error
    except OSError as error:
        raise failure(f"{error.filename}: {error.strerror}" if error.filename else str(error)) from error
    except (GestaError, FormatError) as error:
        raise failure(str(error)) from error
    except (LookupError, TypeError, ValueError) as error:
        if _is_gesta(url):
            raise
        raise failure(f"what answers at {url} is no Gesta server") from error


def number_of(client: GestaClient, model: str, ref: str | None) -> int:
    """Return the number of a version, which does not move under the way; None: as for a stream."""
    try:
        return int(client.version(model, ref or "production")["version"])
    except ApiError as error:
        if ref is not None or error.code != "version_not_found":
            raise
        return int(client.version(model, "latest")["version"])


def create_if_absent(client: GestaClient, model: str, objects: Sequence[str], **fields: Any) -> None:
    """Create a model where there is none of the name; fields as in ``create_model``."""
    try:
        client.model(model)
    except ApiError as error:
        if error.code != "model_not_found":
            raise
        client.create_model(model, objects, **fields)
        tell(f"created the model {model} with the objects {', '.join(objects) or 'none'}")


def awaited(client: GestaClient, answer: Message, what: str) -> Message:
    """Return an answer or, where it is a job, the job's result, with its progress shown meanwhile."""
    if "state" not in answer:
        return answer
    with job_watched(what) as watch:
        return client.result(answer["id"], watch)


def _is_gesta(url: str) -> bool:
    """Whether the documents that a server gives are ours."""
    try:
        return bool(httpx.get(f"{url.rstrip('/')}/v1/openapi.json").json()["info"]["title"] == TITLE)
    except (httpx.HTTPError, LookupError, TypeError, ValueError):
        return False


def _places(error: ApiError) -> list[str]:
    """Return what a problem says of each place in the request."""
    places = error.problem.get("errors") or []
    told = str(error)
    return [f"  {each['pointer']}: {each['detail']}" for each in places if each["detail"] not in told]
