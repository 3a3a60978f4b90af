"""The codec `packbits` of zarr 3, which stores eight booleans in a byte, the lowest bit first.

It is defined by zarr-extensions, and the zarr library does not have it. Only arrays of booleans are
read.
"""

import asyncio
import dataclasses
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from zarr.abc.codec import ArrayBytesCodec
from zarr.registry import register_codec

_PADDINGS = ("none", "first_byte", "last_byte")
"""Where the number of padding bits is stored."""


def decode_packbits(content: npt.NDArray[np.uint8], number: int, padding: str) -> Any:
    """Return `number` booleans that the codec encoded, as an array of bool.

    Raises
    ------
    ValueError
        When the content has another size, or the padding differs.

    Examples
    --------
    >>> decode_packbits(np.array([0b00000101], np.uint8), 3, "none").tolist()
    [True, False, True]
    """
    size = -(-number // 8)
    if len(content) != size + (padding != "none"):
        raise ValueError(f"packbits: expected {size} bytes, got {len(content)}")
    if padding == "first_byte":
        stated, content = int(content[0]), content[1:]
    elif padding == "last_byte":
        stated, content = int(content[-1]), content[:-1]
    else:
        stated = 8 * size - number
    if stated != 8 * size - number:
        raise ValueError(f"packbits: expected {8 * size - number} bits of padding, got {stated}")
    return np.unpackbits(content, count=number, bitorder="little").view(np.bool_)


@dataclasses.dataclass(frozen=True)
class PackBits(ArrayBytesCodec):
    """The codec for arrays of booleans."""

    padding_encoding: str = "none"
    is_fixed_size = True

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the codec of metadata. Raise ValueError for settings that it does not have."""
        settings = data.get("configuration") or {}
        padding = settings.get("padding_encoding") or "none"
        first, last = settings.get("first_bit"), settings.get("last_bit")
        if padding not in _PADDINGS or first not in (None, 0) or last not in (None, 0):
            raise ValueError(f"packbits: expected booleans, got the settings {settings}")
        return cls(padding)

    def to_dict(self) -> dict[str, Any]:
        """Return the metadata."""
        configuration = {"padding_encoding": self.padding_encoding}
        return {"name": "packbits", "configuration": configuration}

    def validate(self, *, dtype: Any, **_: Any) -> None:
        """Raise ValueError for arrays of other types."""
        if dtype.to_native_dtype() != np.dtype(bool):
            raise ValueError(f"packbits: expected an array of bool, got {dtype}")

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        content, number = chunk_bytes.as_numpy_array(), int(np.prod(chunk_spec.shape))
        decoded = await asyncio.to_thread(decode_packbits, content, number, self.padding_encoding)
        return chunk_spec.prototype.nd_buffer.from_numpy_array(decoded.reshape(chunk_spec.shape))

    async def _encode_single(self, chunk_array: Any, chunk_spec: Any) -> Any:
        values = chunk_array.as_numpy_array().ravel()
        content = np.packbits(values, bitorder="little")
        padding = np.array([-len(values) % 8], np.uint8)
        parts = {"first_byte": [padding, content], "last_byte": [content, padding]}
        encoded = np.concatenate(parts.get(self.padding_encoding, [content]))
        return chunk_spec.prototype.buffer.from_array_like(encoded)

    def compute_encoded_size(self, input_byte_length: int, _: Any) -> int:
        """Return the number of bytes of encoded booleans."""
        return -(-input_byte_length // 8) + (self.padding_encoding != "none")


register_codec("packbits", PackBits)
