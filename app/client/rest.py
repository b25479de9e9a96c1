"""The methods of the clients: which request each sends, and what is answered.

One table for both clients: an ``Endpoint`` is a method that returns the answer for ``GestaClient``, and a
coroutine of it for ``AsyncGestaClient``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Coroutine
from functools import update_wrapper
from typing import Any, Generic, ParamSpec, TypeVar, overload

from app.client import answers, requests
from app.client.requests import Request

Asked = ParamSpec("Asked")
Answer = TypeVar("Answer")


class Endpoint(Generic[Asked, Answer]):
    """A request and the type of its answer."""

    def __init__(self, request: Callable[Asked, Request], answer: type[Answer]) -> None:
        self.request, self.answer = request, answer
        self.__doc__ = request.__doc__

    @overload
    def __get__(self, client: Plain, owner: object = None) -> Callable[Asked, Answer]: ...

    @overload
    def __get__(
        self, client: Asyncio, owner: object = None
    ) -> Callable[Asked, Coroutine[Any, Any, Answer]]: ...

    def __get__(self, client: Plain | Asyncio, owner: object = None) -> Callable[Asked, Any]:
        def call(*args: Asked.args, **fields: Asked.kwargs) -> Any:
            return client.ask(self.request(*args, **fields))

        return update_wrapper(call, self.request)


class Rest:
    """Every method returns the server's answer, or the coroutine of it; ApiError where it refuses."""

    create_model = Endpoint(requests.create_model, answers.Model)
    model = Endpoint(requests.model, answers.ModelWithActions)
    change_model = Endpoint(requests.change_model, answers.Model)
    delete_model = Endpoint(requests.delete_model, answers.Empty)
    add_demonstrations = Endpoint(requests.add_demonstrations, answers.Uploaded)
    add_recording = Endpoint(requests.add_recording, answers.Uploaded)
    demonstration = Endpoint(requests.demonstration, answers.Demonstration)
    delete_demonstration = Endpoint(requests.delete_demonstration, answers.Empty)
    train = Endpoint(requests.train, answers.Job)
    job = Endpoint(requests.job, answers.Job)
    cancel = Endpoint(requests.cancel, answers.Job)
    version = Endpoint(requests.version, answers.Version)
    promote = Endpoint(requests.promote, answers.Alias)
    delete_alias = Endpoint(requests.delete_alias, answers.Empty)
    generate = Endpoint(requests.generate, answers.Generated)
    generate_task = Endpoint(requests.generate_task, answers.Task)
    segment = Endpoint(requests.segment, dict[str, Any])
    evaluate = Endpoint(requests.evaluate, dict[str, Any])
    session = Endpoint(requests.session, answers.Session)
    end_session = Endpoint(requests.end_session, answers.Session)
    segments = Endpoint(requests.segments, answers.SegmentEvents)
    learn = Endpoint(requests.learn, answers.Learned)
    recording = Endpoint(requests.recording, answers.Recording)


class Plain(Rest):
    """A client that waits for the answer."""

    @abstractmethod
    def ask(self, request: Request) -> Any:
        """Send a request and return its answer, ``{}`` where it is empty."""


class Asyncio(Rest):
    """A client that gives a coroutine of the answer."""

    @abstractmethod
    async def ask(self, request: Request) -> Any:
        """Send a request and return its answer, ``{}`` where it is empty."""
