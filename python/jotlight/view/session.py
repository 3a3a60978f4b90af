"""One connection of a page: requests in, images out, and never more than one of each waiting."""

import asyncio
import contextlib
import dataclasses
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, TypeVar

from jotlight.array_types import AnyIntegers
from jotlight.errors import error_message
from jotlight.view.facts import describe_capture
from jotlight.view.messages import decode_request, encode
from jotlight.view.pipeline import MAX_KEEPING_UP, ImageRequest, Pipeline, is_quick
from jotlight.view.recipe import recipe
from jotlight.view.state import COUNTS, ViewState, parse_probe
from jotlight.view.viewed import CancelledError
from jotlight.view.workshop import Workshop

R = TypeVar("R")

MAX_UNREAD = 2
"""Maximum number of images that are sent before the page confirms one."""

MAX_SILENCE = 60.0
"""Time in seconds after which a page is disconnected that does not confirm an image."""

LIVE_INTERVAL = 1 / 30
"""Time in seconds between two images of a live capture."""

RATES_INTERVAL = 0.5
"""Time in seconds between two updates of the facts of a live capture."""


class UnreadError(Exception):
    """The page has not confirmed images for a long time."""


class Session:
    """The conversation with one page.

    Parameters
    ----------
    workshop : Workshop
        What all connections share.
    send : callable
        A function that sends a binary message, and waits while the network is busy.
    receive : callable
        A function that waits for a text from the page.
    token : str
        The secret of the server, which links of the page contain.
    """

    def __init__(
        self,
        workshop: Workshop,
        send: Callable[[bytes], Awaitable[None]],
        receive: Callable[[], Awaitable[str]],
        token: str = "",
    ) -> None:
        self._workshop, self._send_bytes, self._receive = workshop, send, receive
        self._token = token
        self._pipeline = Pipeline(workshop)
        self._newest: ImageRequest | None = None
        self._has_request = asyncio.Event()
        self._job: tuple[ImageRequest, AnyIntegers] | None = None
        self._has_job = asyncio.Event()
        self._refining: ImageRequest | None = None
        self._counting: ImageRequest | None = None
        self._unread = asyncio.Semaphore(MAX_UNREAD)
        self._sending = asyncio.Lock()
        self._sent = 0
        self._probe: tuple[int, int] | None = None
        self._follow: ImageRequest | None = None
        self._has_rates = workshop.viewed.is_live

    async def run(self) -> None:
        """Converse until the page leaves, or does not read, or sends something invalid.

        Raises
        ------
        ValueError
            When the page sends an invalid message.
        UnreadError
            When the page does not confirm images.
        """
        capture = describe_capture(self._workshop.viewed)
        await self._send({"type": "hello", "token": self._token, **capture})
        works = [self._listen, self._answer, self._refine, self._watch]
        tasks = [asyncio.ensure_future(work()) for work in works]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for request in (self._newest, self._counting, self._refining):
                if request is not None:
                    request.is_cancelled = True
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    # Messages from the page.

    async def _listen(self) -> None:
        while True:
            message = decode_request(await self._receive())
            kind = message["type"]
            if kind == "view":
                state = ViewState.from_json(message.get("state"))
                number = message.get("id")
                if isinstance(number, bool) or not isinstance(number, int):
                    raise ValueError("id: expected a whole number")
                self._ask(ImageRequest(number, state, message.get("moving") is True))
            elif kind == "ack":
                if self._sent > 0:
                    self._sent -= 1
                    self._unread.release()
            elif kind == "probe":
                self._probe = parse_probe(message)
                await self._send_values()
            elif kind == "recipe":
                await self._send_recipe(ViewState.from_json(message.get("state")))
            else:
                raise ValueError("type: expected view, ack, probe, or recipe")
            await asyncio.sleep(0)  # many messages of one page must not delay the others

    def _ask(self, request: ImageRequest) -> None:
        """Make a request the newest one, which cancels those before it."""
        is_live = self._workshop.viewed.is_live
        self._follow = request if is_live and request.state.follow else None
        for before in (self._newest, self._counting):
            if before is not None:
                before.is_cancelled = True
        if self._refining is not None and not (request.is_moving and self._refining.is_moving):
            self._refining.is_cancelled = True
        self._newest = request
        self._has_request.set()

    # Images to the page.

    async def _answer(self) -> None:
        """Answer the newest request by its counts and maximum likelihood."""
        while True:
            await self._has_request.wait()
            await self._wait_for_reading()
            self._has_request.clear()
            request, self._newest = self._newest, None
            assert request is not None, "the event says that there is a request"
            viewed = self._workshop.viewed
            state = request.state.within(viewed.frames, viewed.cycle)
            request.state, self._counting = state, request
            async with self._reported(request):
                await self._answer_one(request)
            self._counting = None

    async def _answer_one(self, request: ImageRequest) -> None:
        state, pipeline = request.state, self._pipeline
        if pipeline.takes_long(state):
            await self._send_image(await self._quickly(pipeline.sample_counts, request))
        if is_quick(state):
            shown = [state.method] if request.is_moving else [COUNTS, state.method]
        elif self._keeps_up(request):
            shown = []
        else:
            shown = ["mle"] if request.is_moving else [COUNTS, "mle"]
        if state.white is None:
            shown = [method for method in shown if method != COUNTS] or shown
        methods = list(dict.fromkeys(shown))
        counts, image = await self._quickly(pipeline.count, request, methods)
        if image is not None:
            await self._send_image(image)
        for method in methods[1:]:
            await self._send_image(await self._quickly(pipeline.preview, request, counts, method))
        await self._send_values()
        is_more_wanted = bool(state.overlays) or not self._has_rates
        if not is_quick(state) or (is_more_wanted and not self._is_passing(request)):
            self._job = request, counts
            self._has_job.set()

    def _is_passing(self, request: ImageRequest) -> bool:
        """Return whether an image is replaced before its overlays are of use, as under a slider."""
        return request.is_moving and self._follow is None

    def _keeps_up(self, request: ImageRequest) -> bool:
        """Return whether the refinement follows a moving slider without previews."""
        if not request.is_moving:
            return False
        if self._follow is not None:
            return True
        seconds = self._workshop.expected_seconds(request.state)
        return seconds is not None and seconds <= MAX_KEEPING_UP

    async def _refine(self) -> None:
        """Refine the newest image that has been counted, and add its overlays."""
        while True:
            await self._has_job.wait()
            self._has_job.clear()
            assert self._job is not None, "the event says that there is a job"
            (request, counts), self._job = self._job, None
            self._refining = request
            async with self._reported(request):
                if not is_quick(request.state):
                    image = await self._slowly(self._pipeline.refine, request, counts)
                    await self._send_image(image)
                    await self._send_values()
                if not self._is_passing(request):
                    overlays = self._pipeline.overlays(request)
                    while (overlay := await self._slowly(next, overlays, None)) is not None:
                        await self._send_image(overlay)
                    await self._send_values()
            if not self._has_rates and not request.is_moving:
                async with self._reported(request):
                    await self._send_rates(request)
            self._refining = None

    async def _watch(self) -> None:
        """Ask for the newest frames of a live capture, again and again."""
        viewed = self._workshop.viewed
        if not viewed.is_live:
            await asyncio.Event().wait()
        shown, ticks = 0, 0
        while True:
            end, follow = viewed.frames.stop, self._follow
            is_free = not self._has_request.is_set() and self._counting is None
            if follow is not None and end > shown and end > viewed.frames.start and is_free:
                shown = end
                self._newest = dataclasses.replace(follow, is_moving=True, is_cancelled=False)
                self._has_request.set()
            if ticks % round(RATES_INTERVAL / LIVE_INTERVAL) == 0:
                facts = viewed.facts()
                rates = facts.pop("rates", None)
                await self._send({"type": "live", **facts}, rates)
            ticks += 1
            await asyncio.sleep(LIVE_INTERVAL)

    async def _send_rates(self, request: ImageRequest) -> None:
        """Send the readings over time. Frames that cannot be read are reported only once."""
        try:
            rates, each = await self._slowly(self._workshop.rates, request.check)
        except CancelledError:
            return
        except BaseException:
            self._has_rates = True
            raise
        self._has_rates = True
        await self._send({"type": "rates", "frames": each}, rates)

    async def _send_values(self) -> None:
        if self._probe is not None:
            values = self._pipeline.values_at(*self._probe)
            await self._send({"type": "values", "values": values})

    async def _send_recipe(self, state: ViewState) -> None:
        viewed = self._workshop.viewed
        try:
            found = recipe(viewed, state.within(viewed.frames, viewed.cycle))
        except (ValueError, OSError) as error:  # such as a window that the method does not serve
            found = {"command": None, "python": None, "problem": error_message(error)}
        await self._send({"type": "recipe", **found})

    @contextlib.asynccontextmanager
    async def _reported(self, request: ImageRequest) -> AsyncIterator[None]:
        """Ignore cancellation, and report errors of the library to the page."""
        try:
            yield
        except CancelledError:
            pass
        except (ValueError, TypeError, OSError, ImportError, MemoryError, ArithmeticError) as error:
            text = error_message(error)
            await self._send({"type": "error", "id": request.number, "text": text})

    async def _quickly(self, function: Callable[..., R], *arguments: Any) -> R:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._workshop.quick, function, *arguments)

    async def _slowly(self, function: Callable[..., R], *arguments: Any) -> R:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._workshop.slow, function, *arguments)

    async def _wait_for_reading(self) -> None:
        """Wait until the page has confirmed enough images for another one."""
        try:
            await asyncio.wait_for(self._unread.acquire(), MAX_SILENCE)
        except TimeoutError as error:
            raise UnreadError from error
        self._unread.release()

    async def _send_image(self, message: bytes) -> None:
        try:
            await asyncio.wait_for(self._unread.acquire(), MAX_SILENCE)
        except TimeoutError as error:
            raise UnreadError from error
        self._sent += 1
        async with self._sending:
            await self._send_bytes(message)

    async def _send(self, header: dict[str, Any], payload: Any = None) -> None:
        async with self._sending:
            await self._send_bytes(encode(header, payload))
