"""A client of the viewer: requests, a WebSocket, and decoded messages."""

import http.client
import json
import time
from contextlib import contextmanager

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect


def get(server, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in {"Host": f"127.0.0.1:{server.port}", **headers}.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def cookie(server):
    return {"Cookie": f"jotlight-{server.port}={server.token}"}


@contextmanager
def connected(server, origin=None, token=None, **options):
    token = server.token if token is None else token
    address = f"ws://127.0.0.1:{server.port}/stream?token={token}"
    origin = f"http://127.0.0.1:{server.port}" if origin is None else origin
    with connect(address, origin=origin or None, max_size=None, **options) as stream:
        yield stream


def read(stream):
    message = stream.recv(timeout=60)
    size = int.from_bytes(message[:4], "little")
    header = json.loads(message[4 : 4 + size])
    if header["type"] in ("image", "overlay"):
        stream.send('{"type": "ack"}')
    return header, np.frombuffer(message[4 + size :], np.uint8)


def ask(stream, number=1, moving=False, **state):
    state = {"window": 16, "method": "mle", "white": 1.0, **state}
    stream.send(json.dumps({"type": "view", "id": number, "moving": moving, "state": state}))


def read_until(stream, kind, stage=None):
    while True:
        header, payload = read(stream)
        assert header["type"] != "error" or kind == "error", header
        if header["type"] == kind and stage in (None, header.get("stage")):
            return header, payload


def receive_all(stream, timeout, received=None):
    """Receive until an error, and return its type."""
    while True:
        try:
            message = stream.recv(timeout=timeout)
        except (TimeoutError, ConnectionClosed) as error:
            return type(error)
        if received is not None:
            received.append(message)


def is_alive(server):
    return get(server, "/", **cookie(server))[0].status == 200


def wait_until(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)
