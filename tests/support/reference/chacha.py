"""The random numbers of the engine: ChaCha with 8 rounds, and the words that each jot uses."""

import numpy as np

QUARTERS = (
    (0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
    (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14),
)  # fmt: skip


def chacha8(key, stream, blocks, first=0):
    """Return words of a stream, 16 per block; counter and stream have 64 bits each."""
    counters = np.arange(first, first + blocks, dtype="<u8").view("<u4").reshape(-1, 2).T
    constants = np.frombuffer(b"expand 32-byte k" + key + stream.to_bytes(8, "little"), "<u4")
    start = np.tile(constants[:, None], blocks)
    start = np.concatenate([start[:12], counters, start[12:]])
    x = start.copy()
    for _ in range(4):
        for a, b, c, d in QUARTERS:
            for target, source, rotated, bits in (
                (a, b, d, 16),
                (c, d, b, 12),
                (a, b, d, 8),
                (c, d, b, 7),
            ):
                x[target] += x[source]
                x[rotated] ^= x[target]
                x[rotated] = x[rotated] << bits | x[rotated] >> (32 - bits)
    return (x + start).T.astype("<u4").ravel()


GROUP = 512
"""The number of jots whose draws come from the same eight blocks."""


def draws(key, stream, columns):
    """Return the 8-bit draws of the jots of a row.

    The bytes of a group are the first words of its eight blocks, then their second words, and so
    on.
    """
    blocks = chacha8(key, stream, -(-columns // GROUP) * 8).reshape(-1, 8, 16)
    return np.ascontiguousarray(blocks.transpose(0, 2, 1)).view("<u1").ravel()[:columns]


def uniforms(key, *, channel=0, frame=0, row=0, columns):
    """Return U of the jots of a row, in units of 2⁻⁴⁸.

    The upper 8 bits come from one stream, the lower 40 bits from a second one.
    """
    stream = channel << 56 | frame << 24 | row
    rest = chacha8(key, stream | 1 << 63, -(-columns // 8)).view("<u8")[:columns]
    upper = draws(key, stream, columns).astype(np.int64)
    return upper << 40 | (rest >> np.uint64(24)).astype(np.int64)


def noise(key, *, channel=0, frame=0, row=0, columns):
    """Return the two words of 64 bits for the read noise of the jots of a row, (columns, 2)."""
    stream = channel << 56 | frame << 24 | row | 1 << 63
    blocks = chacha8(key, stream, -(-columns // 4), first=1 << 40)
    return blocks.view("<u8").reshape(-1, 2)[:columns]
