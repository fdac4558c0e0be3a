"""The door of the workbench: pages and orders over HTTP, for one person on one machine.

The token admits a browser; requests must name this server as their host, and orders must come from its own
page, so that no other page in the same browser can give them. The page loads nothing from anywhere else.
"""

from __future__ import annotations

import hmac
from functools import partial
from importlib import resources
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, error
from halpipe.core.durations import Duration
from halpipe.exporters.report.scene import scene
from halpipe.workbench.edits import Edit
from halpipe.workbench.picture import picture, plain
from halpipe.workbench.session import Pin

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.workbench.session import Session

BAD_ORDER = error(
    "HAL0955",
    "Workbench does not understand an order",
    "Orders are JSON objects of known words with known fields; the page gives no others.",
)

MAX_BODY = 2**20
COOKIE = "halpipe"
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
    app.add_middleware(_Guard, token=token, hosts=hosts)
    return app


# ------------------------------------------------------------------------------------------------ who may ask


HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class _Guard:
    """Lets through who may ask, and puts on every answer what keeps the page to itself."""

    def __init__(self, app: Any, *, token: str, hosts: set[str]) -> None:
        self._app, self._token, self._hosts = app, token, hosts

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        from starlette.datastructures import MutableHeaders
        from starlette.requests import Request

        async def sealed(message: Any) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        refusal = _refusal(self._token, self._hosts, Request(scope)) if scope["type"] == "http" else None
        await (refusal or self._app)(scope, receive, sealed)


def _refusal(token: str, hosts: set[str], request: Any) -> Any:
    """Return the answer to who may not ask, or comes with the token; None for who may go on."""
    from starlette.responses import PlainTextResponse, RedirectResponse

    origin = request.headers.get("origin")
    if request.headers.get("host") not in hosts:
        return PlainTextResponse("this server answers on 127.0.0.1 only", 403)
    if origin is not None and origin.removeprefix("http://") not in hosts:
        return PlainTextResponse("orders are taken from the page of the workbench only", 403)
    if int(request.headers.get("content-length") or 0) > MAX_BODY or "transfer-encoding" in request.headers:
        return PlainTextResponse("the order is too long", 413)
    if _same(request.query_params.get("token", ""), token):
        response = RedirectResponse("/", 303)
        response.set_cookie(COOKIE, token, httponly=True, samesite="strict")
        return response
    if not _same(request.cookies.get(COOKIE, ""), token):
        return PlainTextResponse("open the address that `halpipe serve` has printed, with its token", 403)
    return None


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


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
        stated = await request.json()
        order = ORDERS[name](stated) if name in ORDERS and isinstance(stated, dict) else None
    except (ValueError, KeyError, TypeError, RecursionError):
        order = None
    if order is None:
        return _refused(session, HalpipeError(BAD_ORDER("the order is not understood", help="load the page again")))
    try:
        said = await run_in_threadpool(_alone, session, order)
    except HalpipeError as refused:
        return _refused(session, refused)
    return _json(picture(session) | ({"said": said} if said else {}))


def _alone(session: Session, order: Callable[[Session], Any]) -> Any:
    with session.lock:
        return order(session)


def _refused(session: Session, refused: HalpipeError) -> Any:
    return _json(picture(session) | {"refused": [plain(found) for found in refused.diagnostics]}, 409)


def _json(value: Any, status: int = 200) -> Any:
    from starlette.responses import JSONResponse

    return JSONResponse(value, status)


# ------------------------------------------------------------------------------------------------ the orders


def _edit(stated: dict[str, Any]) -> Any:
    names = ("kind", "name", "field", "value", "inner", "after")
    edit = Edit(**{name: str(stated[name]) for name in names if name in stated})
    revision = int(stated["revision"])
    return lambda session: session.edit(edit, revision)


def _pin(stated: dict[str, Any]) -> Any:
    start = Duration.parse(str(stated["start"]))
    pin = Pin(str(stated["mode"]), str(stated["task"]), int(stated["index"]), start, str(stated.get("unit", "")))
    revision = int(stated["revision"])
    return lambda session: session.pin(pin, revision)


def _unpin(stated: dict[str, Any]) -> Any:
    task, revision = str(stated.get("task", "")), int(stated["revision"])
    return lambda session: session.unpin(task, revision)


def _undo(_stated: dict[str, Any]) -> Any:
    return lambda session: session.undo()


def _redo(_stated: dict[str, Any]) -> Any:
    return lambda session: session.redo()


def _keep(stated: dict[str, Any]) -> Any:
    name = str(stated["name"])[:100]
    return lambda session: session.keep(name)


def _take(stated: dict[str, Any]) -> Any:
    name, revision = str(stated["name"]), int(stated["revision"])
    return lambda session: session.take(name, revision)


def _compare(stated: dict[str, Any]) -> Any:
    name = str(stated["name"])

    def beside(session: Session) -> Any:
        kept = session.variant(name)
        return scene(kept.model, kept.schedule, is_valid=kept.is_valid)

    return beside


def _save(stated: dict[str, Any]) -> Any:
    path, force = str(stated.get("path", "")), stated.get("force") is True
    return lambda session: f"{session.save(path, force=force)}: written"


def _explain(stated: dict[str, Any]) -> Any:
    mode = str(stated.get("mode", ""))
    return lambda session: [plain(found) for found in session.why(mode)]


def _sensitivity(_stated: dict[str, Any]) -> Any:
    return lambda session: session.margins()


ORDERS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "edit": _edit,
    "pin": _pin,
    "unpin": _unpin,
    "undo": _undo,
    "redo": _redo,
    "keep": _keep,
    "take": _take,
    "compare": _compare,
    "save": _save,
    "explain": _explain,
    "sensitivity": _sensitivity,
}


async def _export(session: Session, request: Any) -> Any:
    """Export what is shown, with what pipeline files may state of the format; several files come as a ZIP archive."""
    from starlette.concurrency import run_in_threadpool
    from starlette.responses import Response

    try:
        stated = await request.json()
        options = {str(key): value for key, value in stated.items()} if isinstance(stated, dict) else {}
        made = await run_in_threadpool(_alone, session, partial(_exported, request.path_params["format"], options))
    except HalpipeError as refused:
        return _refused(session, refused)
    except (ValueError, TypeError):
        return _refused(session, HalpipeError(BAD_ORDER("the order is not understood", help="load the page again")))
    name, kind, content = made
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type=kind, headers=headers)


def _exported(format: str, options: dict[str, Any], session: Session) -> tuple[str, str, bytes]:
    files = session.exported(format, options)
    suffix = session.suffix_of(format)
    if set(files) == {""}:
        return f"export{suffix}", "application/octet-stream", files[""]
    return f"{format}.zip", "application/zip", _zipped(files, f"export{suffix}")


def _zipped(files: dict[str, bytes], main: str) -> bytes:
    import io
    import zipfile

    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            archive.writestr(zipfile.ZipInfo(name or main), files[name])
    return packed.getvalue()
