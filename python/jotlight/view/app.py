"""The web application: one page, its static files, a WebSocket, and saved images."""

import asyncio
import json
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from jotlight.errors import error_message
from jotlight.view.access import (
    Ticket,
    accepts_host,
    accepts_origin,
    accepts_token,
    cookie_token,
)
from jotlight.view.saving import ENDINGS, file_name, save_view
from jotlight.view.session import Session, UnreadError
from jotlight.view.state import MAX_STATE_BYTES, ViewState
from jotlight.view.workshop import Workshop

MAX_PAGES = 8
"""Maximum number of pages that are connected at a time."""

_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}

_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every response. The page runs no script but its own, and no other site embeds it."""

_UNKNOWN = "the token is missing or wrong; use the address that jotlight view printed"

_TOO_MANY = f"This viewer already has {MAX_PAGES} pages, which is the limit. Close one of them."

_REFUSED = 1008
"""WebSocket code for a client that breaks the rules."""


def make_app(
    workshop: Workshop,
    token: str,
    names: frozenset[str],
    ticket: Ticket,
    *,
    port: int,
    any_address: bool = False,
) -> ASGIApp:
    """Return the application that serves a capture.

    Parameters
    ----------
    workshop : Workshop
        The capture.
    token : str
        The secret that the address of the page contains.
    names : frozenset of str
        Names of this server in the header Host.
    ticket : Ticket
        A secret for the address that a browser is started with.
    port : int
        The port, which is part of the cookie's name, because browsers share cookies among ports.
    any_address : bool
        Whether the header Host may be any IP address.
    """
    pages = _page_files()
    connected: set[WebSocket] = set()

    async def page(request: Request) -> Response:
        name = request.path_params.get("name") or "index.html"
        content = pages.get(name)
        if content is None:
            return PlainTextResponse("not found", 404)
        return Response(content, media_type=_TYPES[name[name.rindex(".") :]])

    async def save(request: Request) -> Response:
        return await _save(request, workshop)

    async def stream(socket: WebSocket) -> None:
        if len(connected) >= MAX_PAGES:
            # Browsers show the reason of a connection that was accepted, but of no other one.
            await socket.accept()
            await socket.close(_REFUSED, _TOO_MANY)
            return
        connected.add(socket)
        try:
            await _converse(socket, workshop, token)
        finally:
            connected.discard(socket)

    routes = [
        Route("/", page, methods=["GET"]),
        Route("/page/{name}", page, methods=["GET"]),
        Route("/save", save, methods=["GET"]),
        WebSocketRoute("/stream", stream),
    ]
    cookie = f"jotlight-{port}"
    return _Guard(Starlette(routes=routes), token, ticket, names, cookie, any_address)


def _page_files() -> dict[str, bytes]:
    """Return the files of the page. No request leads to any other file."""
    folder = files("jotlight.view").joinpath("page")
    names = (entry.name for entry in folder.iterdir())
    return {name: folder.joinpath(name).read_bytes() for name in names if name.endswith((*_TYPES,))}


class _Guard:
    """Refuse requests with a foreign Host or Origin, or without the token."""

    def __init__(
        self,
        app: ASGIApp,
        token: str,
        ticket: Ticket,
        names: frozenset[str],
        cookie: str,
        any_address: bool,
    ) -> None:
        self._app, self._token, self._ticket, self._names = app, token, ticket, names
        self._cookie, self._any_address = cookie, any_address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        refusal = self._foreign(scope, headers)
        if refusal is not None:
            await _refuse(scope, receive, send, refusal)
            return
        given, is_first = _query(scope, "token"), False
        if scope["type"] == "http" and scope["path"] == "/":
            is_first = accepts_token(given, self._token)
            is_first = is_first or self._ticket.redeem(_query(scope, "ticket"))
        if is_first:
            # As in Jupyter, the secret of the address becomes a cookie.
            response = RedirectResponse("/", 303, dict(_HEADERS))
            response.set_cookie(self._cookie, self._token, httponly=True, samesite="lax")
            await response(scope, receive, send)
            return
        cookie = cookie_token(headers.get("cookie"), self._cookie)
        if not any(accepts_token(each, self._token) for each in (given, cookie)):
            await _refuse(scope, receive, send, _UNKNOWN)
            return

        async def send_with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                extra = [(name.lower().encode(), text.encode()) for name, text in _HEADERS.items()]
                message = {**message, "headers": [*message["headers"], *extra]}
            await send(message)

        await self._app(scope, receive, send_with_headers)

    def _foreign(self, scope: Scope, headers: dict[str, str]) -> str | None:
        """Return why a request is not one of a page of this server, or None."""
        host = headers.get("host")
        if not accepts_host(host, self._names, any_address=self._any_address):
            return "the header Host does not name this server"
        is_socket = scope["type"] == "websocket"
        if not accepts_origin(headers.get("origin"), host, required=is_socket):
            return "the header Origin is that of another site"
        return None


def _query(scope: Scope, name: str) -> str | None:
    value: str | None = Request({**scope, "type": "http"}).query_params.get(name)
    return value


async def _refuse(scope: Scope, receive: Receive, send: Send, reason: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": _REFUSED, "reason": reason})
        return
    # Otherwise, a client that sends many requests and reads no answer would keep its connection.
    headers = {**_HEADERS, "Connection": "close"}
    await PlainTextResponse(reason, 403, headers)(scope, receive, send)


async def _converse(socket: WebSocket, workshop: Workshop, token: str) -> None:
    """Run a session until the page leaves or breaks a rule."""
    await socket.accept()
    session = Session(workshop, socket.send_bytes, socket.receive_text, token)
    reason = ""
    try:
        await session.run()
    except WebSocketDisconnect:
        return
    except UnreadError:
        reason = "the page does not read its images"
    except (ValueError, KeyError) as error:
        reason = str(error)
    if socket.application_state is WebSocketState.CONNECTED:
        # The protocol limits the reason to 123 bytes.
        await socket.close(_REFUSED, reason.encode()[:123].decode(errors="ignore"))


async def _save(request: Request, workshop: Workshop) -> Response:
    """Return an image as a file."""
    text, ending = request.query_params.get("state", ""), request.query_params.get("format", "")
    if len(text) > MAX_STATE_BYTES or ending not in ENDINGS:
        return PlainTextResponse(f"format: expected one of {', '.join(ENDINGS)}", 400)
    with workshop.saving() as is_free:
        if not is_free:
            return PlainTextResponse("too many files are being saved; try again", 503)
        try:
            state = ViewState.from_json(json.loads(text))
            loop = asyncio.get_running_loop()
            content = await loop.run_in_executor(
                workshop.slow, save_view, workshop.viewed, state, ending
            )
        except (
            ValueError,
            TypeError,
            OSError,
            ImportError,
            ArithmeticError,
            RecursionError,
        ) as error:
            return PlainTextResponse(error_message(error), 400)
    name = file_name(workshop.viewed, state, ending)
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type=ENDINGS[ending], headers=headers)
