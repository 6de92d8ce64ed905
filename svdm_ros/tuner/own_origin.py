"""Requests that pages of other origins make a browser send are refused: for a server that listens to this machine."""
from __future__ import annotations

import ipaddress
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

type _Scope = MutableMapping[str, Any]
type _Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
type _Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

_NAMES = ('localhost',)
_FRAME = (b'x-frame-options', b'DENY')


class OwnOrigin:
    """ASGI middleware, for HTTP and websockets.

    Host must be an address, localhost or one of `names`: a name that somebody else made point here is refused, and with
    it what pages of that name could do (DNS rebinding). Origin, where the browser sends one, must be this host; a
    websocket must have one. No other page may show this one in a frame.
    """

    def __init__(self, app: Callable[[_Scope, _Receive, _Send], Awaitable[None]], names: tuple[str, ...] = ()) -> None:
        self._app = app
        self._names = {name.lower() for name in (*_NAMES, *names)}

    async def __call__(self, scope: _Scope, receive: _Receive, send: _Send) -> None:
        if scope['type'] not in ('http', 'websocket') or self._is_own(scope):
            await self._app(scope, receive, _framed(send) if scope['type'] == 'http' else send)
        elif scope['type'] == 'websocket':
            await receive()
            await send({'type': 'websocket.close', 'code': 1008})
        else:
            await send({'type': 'http.response.start', 'status': 403, 'headers': [(b'content-type', b'text/plain')]})
            await send({'type': 'http.response.body', 'body': b'refused: this page takes requests of its own only\n'})

    def _is_own(self, scope: _Scope) -> bool:
        headers: dict[bytes, str] = {
            name.lower(): value.decode('latin-1').lower() for name, value in scope['headers']}
        host, origin = headers.get(b'host', ''), headers.get(b'origin')
        if not self._is_known(host):
            return False
        if origin is None:  # a link that somebody follows, and no picture or script of another page
            is_foreign = headers.get(b'sec-fetch-site') == 'cross-site'
            is_embedded = is_foreign and headers.get(b'sec-fetch-mode') != 'navigate'
            return bool(scope['type'] == 'http') and not is_embedded
        return origin in (f'http://{host}', f'https://{host}')

    def _is_known(self, host: str) -> bool:
        name = host.rpartition(':')[0] if not host.endswith(']') and ':' in host else host
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name.strip('[]'))
        except ValueError:
            return False
        return True


def _framed(send: _Send) -> _Send:
    async def with_header(message: MutableMapping[str, Any]) -> None:
        if message['type'] == 'http.response.start':
            message = {**message, 'headers': [*message.get('headers', ()), _FRAME]}
        await send(message)
    return with_header
