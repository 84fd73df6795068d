"""The web application: one page, its two files, the newest document, and a stream of them.

Everything is read-only. What is served is a fixed list of names, so no path can lead elsewhere;
requests must name a host that this program was started for, which keeps pages from elsewhere out
even where a name server lies to the browser; beyond loopback a token is asked for.
"""

from __future__ import annotations

import asyncio
import hmac
import json
from collections.abc import AsyncGenerator, AsyncIterator, Mapping
from contextlib import asynccontextmanager
from importlib.resources import files
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from gcs_sysid.dashboard.watch import Watch

COOKIE = "gcs_sysid_token"
MOST_CLIENTS = 16
"""Pages that may follow at the same time."""
ASSETS: Mapping[str, tuple[str, str]] = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    **{
        f"/{name}": (name, "text/javascript; charset=utf-8")
        for name in ("page.js", "learning.js", "start.js")
    },
}
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Lets requests through that name a known host and, where one is asked for, the token.

    Args:
        app: what is guarded.
        hosts: names of this computer, without port; empty takes any.
        token: secret; empty asks for none.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str], token: str) -> None:
        self._app, self._hosts, self._token = app, hosts, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers, or hands the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        refusal = self._refusal(request)
        if refusal is not None:
            await PlainTextResponse(refusal, status_code=403, headers=dict(HEADERS))(
                scope, receive, send
            )
            return
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token")
        if given and self._token:
            # From here on the cookie carries it, and the address can be shown.
            answer = Response(status_code=303, headers={**HEADERS, "Location": "/"})
            answer.set_cookie(COOKIE, self._token, httponly=True, samesite="strict")
            await answer(scope, receive, send)
            return
        await self._app(scope, receive, send)

    def _refusal(self, request: Request) -> str | None:
        host = request.headers.get("host", "").rpartition(":")[0] or request.headers.get("host", "")
        if self._hosts and host.strip("[]") not in self._hosts:
            return "this address is not served here"
        if request.headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return "pages from elsewhere are not answered"
        if not self._token:
            return None
        given = request.query_params.get("token") or request.cookies.get(COOKIE, "")
        good = hmac.compare_digest(given.encode(), self._token.encode())
        return None if good else "open the address with the token that was printed at the start"


def build(watch: Watch, *, hosts: frozenset[str] = frozenset(), token: str = "") -> Starlette:
    """The application.

    Args:
        watch: what is shown.
        hosts: names under which requests may come; empty takes any.
        token: secret that requests must carry; empty asks for none.
    """
    contents = {
        path: ((files("gcs_sysid.dashboard") / "assets" / name).read_bytes(), kind)
        for path, (name, kind) in ASSETS.items()
    }
    following: set[int] = set()

    async def asset(request: Request) -> Response:
        content, kind = contents[request.url.path]
        return Response(content, headers={**HEADERS, "Content-Type": kind})

    async def live(_request: Request) -> Response:
        return JSONResponse(watch.document or {}, headers=dict(HEADERS))

    async def history(_request: Request) -> Response:
        return JSONResponse(list(watch.history), headers=dict(HEADERS))

    async def events(request: Request) -> Response:
        if len(following) >= MOST_CLIENTS:
            return PlainTextResponse("too many pages follow", 503, headers=dict(HEADERS))

        async def stream() -> AsyncIterator[str]:
            following.add(id(request))
            try:
                async for version, document in watch.news():
                    text = json.dumps({"age_s": watch.age_s, "document": document})
                    yield f"id: {version}\ndata: {text}\n\n"
            finally:
                following.discard(id(request))

        return StreamingResponse(stream(), headers={**HEADERS, "Content-Type": "text/event-stream"})

    @asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncGenerator[None, None]:
        watching = asyncio.create_task(watch.watching())
        yield
        watching.cancel()

    return Starlette(
        routes=[
            *(Route(path, asset) for path in ASSETS),
            Route("/live.json", live),
            Route("/history.json", history),
            Route("/events", events),
        ],
        middleware=[Middleware(Guard, hosts=hosts, token=token)],
        lifespan=lifespan,
    )
