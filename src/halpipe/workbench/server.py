"""Access to the workbench: pages and orders over HTTP, for one person on one machine.

The token of the address admits one browser, once: it is traded for a cookie of this port. Requests must name this
server as their host, and orders must come from its own page, so that no other page in the same browser can give them.
The page loads nothing from anywhere else.
"""

from __future__ import annotations

import hmac
import json
import secrets
from functools import partial
from importlib import resources
from operator import methodcaller
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location, error
from halpipe.core.durations import Duration
from halpipe.core.files import CANNOT_READ, is_ended, load_json
from halpipe.core.options import from_keywords
from halpipe.flow.formats import exporter
from halpipe.workbench.edits import Edit, Pin
from halpipe.workbench.picture import picture, plain
from halpipe.workbench.session import LOWER, Session

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.exporters.common.base import ExportOptions

    Order = Callable[[Session], Any]

BAD_ORDER = error(
    "HAL0955",
    "Workbench does not understand an order",
    "Orders are JSON objects of known words with known fields; the page gives no others.",
)

MAX_BODY = 1_048_576
LONGEST_NAME = 100
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
FILES = {
    "": ("halpipe.workbench", "static/workbench.html", "text/html; charset=utf-8"),
    "workbench.js": ("halpipe.workbench", "static/workbench.js", "text/javascript; charset=utf-8"),
    "viewer.js": ("halpipe.exporters.report", "templates/viewer.js", "text/javascript; charset=utf-8"),
    "workbench.css": ("halpipe.workbench", "static/workbench.css", "text/css; charset=utf-8"),
}
"""The pages by name: package, place in it, and media type. The viewer is that of the report."""


def application(session: Session, token: str, port: int) -> Any:
    """Return the ASGI application; `port` is the one that it will be asked at."""
    from starlette.applications import Starlette
    from starlette.routing import Route

    hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
    routes = [
        Route("/api/state", partial(_state, session)),
        Route("/api/progress", partial(_progress, session)),
        Route("/api/export/{format}", partial(_export, session), methods=["POST"]),
        Route("/api/{order}", partial(_order, session), methods=["POST"]),
        Route("/{name:path}", _file),
    ]
    app = Starlette(routes=routes)
    app.add_middleware(_Guard, token=token, hosts=hosts, port=port)
    return app


# ------------------------------------------------------------------------------------------------ who may ask


HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class _Guard:
    """Filter of requests: admits those with the cookie, and seals every answer with the policy of the page."""

    def __init__(self, app: Any, *, token: str, hosts: set[str], port: int) -> None:
        self._app, self._hosts = app, hosts
        self._cookie = f"halpipe-{port}"  # browsers keep cookies by host, not by port
        self._token, self._pass = token, secrets.token_urlsafe(24)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        from starlette.datastructures import MutableHeaders
        from starlette.requests import Request

        async def sealed(message: Any) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        refusal = self._refusal(Request(scope)) if scope["type"] == "http" else None
        await (refusal or self._app)(scope, receive, sealed)

    def _refusal(self, request: Any) -> Any:
        """Return the answer to a request that is not admitted, or that trades the token; None for an admitted one."""
        from starlette.responses import PlainTextResponse, RedirectResponse

        origin = request.headers.get("origin")
        if request.headers.get("host") not in self._hosts:
            return PlainTextResponse("this server answers on 127.0.0.1 only", 403)
        if origin is not None and origin.removeprefix("http://") not in self._hosts:
            return PlainTextResponse("orders are taken from the page of the workbench only", 403)
        if int(request.headers.get("content-length") or 0) > MAX_BODY or "transfer-encoding" in request.headers:
            return PlainTextResponse("the order is too long", 413)
        is_known = _same(request.cookies.get(self._cookie, ""), self._pass)
        if "token" in request.query_params and (is_known or _same(request.query_params["token"], self._token)):
            response = RedirectResponse("/", 303)
            if not is_known:
                self._token = secrets.token_urlsafe(24)  # it admits no other user: histories and process lists keep it
                response.set_cookie(self._cookie, self._pass, httponly=True, samesite="strict")
            return response
        if not is_known:
            text = "open the address that `halpipe serve` has printed; its token admits one browser, once"
            return PlainTextResponse(text, 403)
        return None


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "surrogatepass"), token.encode())


# ------------------------------------------------------------------------------------------------ what is asked


async def _file(request: Any) -> Any:
    from starlette.responses import PlainTextResponse, Response

    found = FILES.get(request.path_params["name"])
    if found is None:
        return PlainTextResponse("there is no such page", 404)
    package, name, kind = found
    return Response(resources.files(package).joinpath(name).read_bytes(), media_type=kind)


async def _state(session: Session, _request: Any) -> Any:
    return _json(picture(session))


async def _progress(session: Session, _request: Any) -> Any:
    found = session.progress
    return _json({"mode": found[0], "made": found[1], "allowed": found[2]} if found else {})


async def _order(session: Session, request: Any) -> Any:
    """Take an order; answer with the new state, or with the reasons of a refusal."""
    from starlette.concurrency import run_in_threadpool

    name = request.path_params["order"]
    if name == "cancel":  # while another order is at work
        session.cancel()
        return _json({})
    try:
        order = _understood(await request.body(), ORDERS.get(name))
        said = await run_in_threadpool(order, session)
    except HalpipeError as refused:
        return _refused(session, refused)
    return _json(picture(session) | ({"said": said} if said else {}))


def _understood(body: bytes, made: Callable[[dict[str, Any]], Order] | None) -> Order:
    """Return the order that `made` makes of its fields, on the state that the page shows.

    Raise `HalpipeError` for everything else: an order with a field too many has meant something.
    """
    try:
        stated = load_json(body)
        text = json.dumps(stated, ensure_ascii=False, allow_nan=False)
        text.encode()  # no lone surrogates, no infinite numbers
        if made is not None and isinstance(stated, dict) and "\\u0000" not in text:
            revision, act = _number(stated, "revision"), made(stated)
            if not stated:
                return partial(_shown, revision, act)
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError):
        pass
    raise HalpipeError(BAD_ORDER("the order is not understood", help="load the page again"))


def _shown(revision: int, act: Order, session: Session) -> Any:
    with session.lock:
        session.check(revision)
        return act(session)


def _refused(session: Session, refused: HalpipeError) -> Any:
    return _json(picture(session) | {"refused": [plain(found) for found in refused.diagnostics]}, 409)


def _json(value: Any, status: int = 200) -> Any:
    from starlette.responses import JSONResponse

    return JSONResponse(value, status)


# ------------------------------------------------------------------------------------------------ the orders


# Each takes its fields out of the stated ones.


def _text(stated: dict[str, Any], name: str, default: str | None = None) -> str:
    value = stated.pop(name, default)
    if not isinstance(value, str):
        raise TypeError(name)
    return value


def _number(stated: dict[str, Any], name: str) -> int:
    value = stated.pop(name)
    if not isinstance(value, int) or isinstance(value, bool):  # 1.5 would be cut
        raise TypeError(name)
    return value


def _edit(stated: dict[str, Any]) -> Order:
    names = ("kind", "name", "field", "value", "inner", "after")
    edit = Edit(**{name: _text(stated, name) for name in names if name in stated})
    return lambda session: session.edit(edit)


def _pin(stated: dict[str, Any]) -> Order:
    start = Duration.parse(_text(stated, "start"))
    mode, task, unit = _text(stated, "mode"), _text(stated, "task"), _text(stated, "unit", "")
    pin = Pin(mode, task, _number(stated, "index"), start, unit)
    return lambda session: session.pin(pin)


def _keep(stated: dict[str, Any]) -> Order:
    name = _text(stated, "name")
    if len(name) > LONGEST_NAME:
        raise ValueError(name)
    return lambda session: session.keep(name)


def _draw_under(stated: dict[str, Any]) -> Order:
    kind, name = _text(stated, "kind"), _text(stated, "name")
    if kind not in LOWER:
        raise ValueError(kind)
    if kind == "trace" and not is_ended(name):  # a pipe would block every later order
        raise HalpipeError(CANNOT_READ("is no plain file", at=Location(name), help="name a plain file"))
    return lambda session: session.draw_under(kind, name)


def _save(stated: dict[str, Any]) -> Order:
    path, force = _text(stated, "path", ""), stated.pop("force", False)
    if not isinstance(force, bool):
        raise TypeError("force")
    return lambda session: f"{session.save(path, force=force)}: written"


def _explain(stated: dict[str, Any]) -> Order:
    mode = _text(stated, "mode", "")
    return lambda session: [plain(found) for found in session.why(mode)]


ORDERS: dict[str, Callable[[dict[str, Any]], Order]] = {
    "edit": _edit,
    "pin": _pin,
    "settle": lambda _: methodcaller("settle"),
    "unpin": lambda _: methodcaller("unpin"),
    "undo": lambda _: methodcaller("undo"),
    "redo": lambda _: methodcaller("redo"),
    "keep": _keep,
    "take": lambda stated: methodcaller("take", _text(stated, "name")),
    "beside": _draw_under,
    "save": _save,
    "explain": _explain,
    "sensitivity": lambda _: methodcaller("margins"),
}


async def _export(session: Session, request: Any) -> Any:
    """Export what is shown, with what pipeline files may state of the format; several files come as a ZIP archive."""
    from starlette.concurrency import run_in_threadpool
    from starlette.responses import Response

    try:
        order = _understood(await request.body(), partial(_exported, request.path_params["format"]))
        made = await run_in_threadpool(order, session)
    except HalpipeError as refused:
        return _refused(session, refused)
    name, kind, content = made
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type=kind, headers=headers)


def _exported(format: str, stated: dict[str, Any]) -> Order:
    kind = exporter(format).options
    options = kind(**from_keywords(f"export {format}", kind, stated))
    for value in stated.values():
        for text in value if isinstance(value, list) else (value,):
            if isinstance(text, str) and not is_ended(text):
                raise HalpipeError(CANNOT_READ("is no plain file", at=Location(text), help="name a plain file"))
    stated.clear()
    return partial(_files, format, options)


def _files(format: str, options: ExportOptions, session: Session) -> tuple[str, str, bytes]:
    import io
    import zipfile

    files = session.exported(format, options)
    suffix = exporter(format).suffix
    if set(files) == {""}:
        return f"export{suffix}", "application/octet-stream", files[""]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            archive.writestr(zipfile.ZipInfo(name or f"export{suffix}"), files[name])
    return f"{format}.zip", "application/zip", packed.getvalue()
