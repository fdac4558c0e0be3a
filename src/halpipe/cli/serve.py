"""``halpipe serve``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.options import WorkerCount, number, takes
from halpipe.core.diagnostics import Exit, HalpipeError, error
from halpipe.core.files.scratch import scratch_folder

if TYPE_CHECKING:
    from socket import socket

NO_SERVER = error(
    "HAL0958", "Workbench is not installed", "The server library comes with the extra: pip install starlette uvicorn."
)
PORT_TAKEN = error("HAL0959", "Port cannot be used", "Another program has it, or the system does not give it.")

PARTING_SECONDS = 2
"""How long Ctrl-C waits for browsers that keep their connection open."""


@takes()
def serve(
    model: Annotated[str, typer.Argument(metavar="MODEL", help="Task model XML.")],
    port: Annotated[int, number(0, 65535, help="Port on 127.0.0.1; 0: any that is free.")] = 0,
    browser: Annotated[bool, typer.Option("--browser", help="Open the page in a browser.")] = False,
    workers: WorkerCount = None,
) -> int:
    """Open a model in the browser: edit it in place, drag jobs, and see a verified schedule at once.

    The page is served to this machine only, and only with the token in its address. Ctrl-C ends the server.
    """
    import secrets
    import threading

    try:
        import uvicorn

        from halpipe.workbench.server import application
    except ImportError:
        raise HalpipeError(NO_SERVER("starlette or uvicorn is missing", help="pip install starlette uvicorn")) from None
    from halpipe.cli.searching import processor_count
    from halpipe.workbench.session import RESTORED, Session

    listening = _listen(port)
    session = Session(model, workers or processor_count())
    token = secrets.token_urlsafe(24)
    number = listening.getsockname()[1]
    address = f"http://127.0.0.1:{number}/?token={token}"
    output.result(address)
    output.flush_results()
    if session.past:
        output.say(f"{session.journal.path}: {RESTORED} are restored: save them in the page, or undo them")
    threading.Thread(target=session.begin, daemon=True).start()
    app = application(session, token, number)
    config = uvicorn.Config(
        app, log_level="warning", server_header=False, lifespan="off", timeout_graceful_shutdown=PARTING_SECONDS
    )
    with scratch_folder() as folder:
        if browser:
            _open(address, folder)
        _end_when_the_terminal_closes()
        try:
            uvicorn.Server(config).run(sockets=[listening])
        finally:  # Ctrl-C is raised again once the server has ended
            session.close()
    return Exit.OK


def _end_when_the_terminal_closes() -> None:
    """Let SIGHUP be the SIGTERM that the server expects: an exception within its loop leaves it half stopped."""
    import signal

    hangup = getattr(signal, "SIGHUP", None)  # Windows has no terminals that hang up
    if hangup is not None and signal.getsignal(hangup) is signal.default_int_handler:
        signal.signal(hangup, lambda *_: signal.raise_signal(signal.SIGTERM))


def _listen(port: int) -> socket:
    import socket as sockets

    # Named, TCP_NODELAY keeps small packets from waiting, which would hold every second answer for 40 ms.
    listening = sockets.socket(sockets.AF_INET, sockets.SOCK_STREAM, sockets.IPPROTO_TCP)
    try:
        listening.setsockopt(sockets.SOL_SOCKET, sockets.SO_REUSEADDR, 1)
        listening.bind(("127.0.0.1", port))
        listening.listen()
    except OSError as failure:
        listening.close()
        raise HalpipeError(PORT_TAKEN(f"port {port}: {failure.strerror}", help="leave --port out")) from None
    return listening


def _open(address: str, folder: str) -> None:
    """Open a page of a private folder that leads to the address, which else would stand in the list of processes."""
    import webbrowser
    from pathlib import Path

    page = Path(folder, "open.html")
    page.write_text(f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={address}"><title>halpipe</title>')
    if not webbrowser.open(page.as_uri()):
        output.say("there is no browser to open; open the address above in one")
