"""Whose requests are taken."""
import asyncio

import pytest

from svdm_ros.tuner.own_origin import OwnOrigin

HOST = '127.0.0.1:8080'


def answer(kind, names=(), **headers):
    """'taken', or what is sent instead."""
    sent = []

    async def app(_scope, _receive, send):
        await send({'type': 'http.response.start', 'status': 200, 'headers': []} if kind == 'http'
                   else {'type': 'websocket.accept'})

    async def receive():
        return {'type': 'websocket.connect'}

    async def send(message):
        sent.append(message)

    scope = {'type': kind, 'headers': [(name.encode(), value.encode()) for name, value in headers.items()]}
    asyncio.run(OwnOrigin(app, names)(scope, receive, send))
    return sent


@pytest.mark.parametrize('host', [HOST, 'localhost:8080', '[::1]:8080', '192.168.1.5:80', '127.0.0.1', 'robot:8080',
                                  'Robot:8080'])
def test_addresses_and_known_names_are_taken(host):
    [message] = answer('http', ('roBot',), host=host)
    assert message['status'] == 200 and (b'x-frame-options', b'DENY') in message['headers']
    assert answer('websocket', ('robot',), host=host, origin=f'http://{host}') == [{'type': 'websocket.accept'}]


@pytest.mark.parametrize(('kind', 'headers'), [
    ('http', {'host': 'evil.example:8080'}),
    ('http', {'host': HOST, 'origin': 'http://evil.example'}),
    ('http', {'host': HOST, 'origin': 'null'}),
    ('http', {'host': HOST, 'origin': 'http://127.0.0.1:9999'}),
    ('http', {}),
    ('http', {'host': HOST, 'sec-fetch-site': 'cross-site', 'sec-fetch-mode': 'no-cors'}),
    ('websocket', {'host': HOST, 'origin': 'http://evil.example'}),
    ('websocket', {'host': HOST}),
    ('websocket', {'host': 'evil.example:8080', 'origin': 'http://evil.example:8080'}),
    ('websocket', {'host': '127.0.0.1.evil.example', 'origin': 'http://127.0.0.1.evil.example'}),
])
def test_those_of_others_are_refused(kind, headers):
    sent = answer(kind, **headers)
    assert sent[0].get('status') == 403 if kind == 'http' else sent == [{'type': 'websocket.close', 'code': 1008}]


def test_what_is_neither_passes():
    assert answer('lifespan')
