"""The random numbers of the engine: ChaCha with 8 rounds, and the words that each jot uses."""

import numpy as np

QUARTERS = (
    (0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
    (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14),
)  # fmt: skip


def chacha8(key, stream, blocks):
    """Return the first words of a stream, 16 per block; counter and stream have 64 bits each."""
    counters = np.arange(blocks, dtype="<u8").view("<u4").reshape(-1, 2).T
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


def uniforms(key, *, channel=0, frame=0, row=0, columns):
    """Return U of the jots of a row, in units of 2⁻⁴⁸.

    The upper 16 bits come from one stream, the lower 32 bits from a second one.
    """
    stream = channel << 56 | frame << 24 | row
    first = chacha8(key, stream, -(-columns // 32)).view("<u2")[:columns]
    rest = chacha8(key, stream | 1 << 63, -(-columns // 16))[:columns]
    return first.astype(np.int64) << 32 | rest
