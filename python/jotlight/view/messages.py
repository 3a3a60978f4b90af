"""Messages between the server and the page.

A message to the page is binary: the length of a header in four bytes (little-endian), the header in
JSON, padded with spaces to a multiple of four bytes, and then the values of an array.
"""

import json
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.view.state import MAX_STATE_BYTES


def encode(header: dict[str, Any], payload: npt.NDArray[Any] | None = None) -> bytes:
    r"""Return a message with a header and an array.

    Examples
    --------
    >>> message = encode({"type": "image"}, np.arange(3, dtype=np.uint8))
    >>> message[:4], message[4:-3], message[-3:]
    (b'\x14\x00\x00\x00', b'{"type": "image"}   ', b'\x00\x01\x02')
    """
    text = json.dumps(header, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    values = b"" if payload is None else np.ascontiguousarray(payload).tobytes()
    return len(text).to_bytes(4, "little") + text + values


def decode_request(text: str) -> dict[str, Any]:
    """Return the object in a message from the page.

    Raises
    ------
    ValueError
        When the message is too long, is not JSON, or is no object with a type.

    Examples
    --------
    >>> decode_request('{"type": "ack"}')
    {'type': 'ack'}
    """
    if len(text) > MAX_STATE_BYTES:
        raise ValueError(f"message: expected at most {MAX_STATE_BYTES} bytes, got {len(text)}")
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError("message: expected an object of JSON") from error
    if not isinstance(value, dict) or not isinstance(value.get("type"), str):
        raise ValueError("message: expected an object of JSON with a type")
    return value
