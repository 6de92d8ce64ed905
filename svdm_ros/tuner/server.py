"""Serves the page, from this machine to this machine unless told otherwise."""
from __future__ import annotations

import socket

from nicegui import app, ui

from .own_origin import OwnOrigin
from .page import Page
from .tuning_session import TuningSession


def check_free(host: str, port: int) -> None:
    """ValueError, in one line, where the page cannot be served there."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as taken:
            taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            taken.bind(address)
    except OSError as error:
        option = '--host' if isinstance(error, socket.gaierror) else '--port'
        raise ValueError(f'port {port} of {host} cannot be used ({error.strerror}): name another by {option}') from None


def serve(session: TuningSession, host: str, port: int) -> None:
    """Until SIGINT or SIGTERM. One line with the address is printed once the page is there."""
    app.add_middleware(OwnOrigin, names=(host, socket.gethostname()))
    ui.page('/', title=f'{session.source.title}: tuner')(lambda: Page(session).build())
    shown = f'[{host}]' if ':' in host else host
    app.on_startup(lambda: print(f'tuner: http://{shown}:{port}, until Ctrl-C', flush=True))
    # No history of messages: it would keep a minute of pictures for each browser.
    ui.run(host=host, port=port, title='tuner', dark=None, reload=False, show=False, show_welcome_message=False,
           message_history_length=0, tailwind=False, uvicorn_logging_level='error')
