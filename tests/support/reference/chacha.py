"""The random numbers of the engine: ChaCha with 8 rounds, and which of its words is a jot's."""

import numpy as np

QUARTERS = (
    (0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
    (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14),
)  # fmt: skip


def chacha8(key, stream, blocks):
    """The first words of a stream, 16 a block; counter and stream have 64 bits each."""
    counters = np.arange(blocks, dtype="<u8").view("<u4").reshape(-1, 2).T
    constants = np.frombuffer(b"expand 32-byte k" + key + stream.to_bytes(8, "little"), "<u4")
    start = np.tile(constants[:, None], blocks)
    start = np.concatenate([start[:12], counters, start[12:]])
    x = start.copy()
    for _ in range(4):
        for a, b, c, d in QUARTERS:
            for to, by, turned, bits in ((a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)):
                x[to] += x[by]
                x[turned] ^= x[to]
                x[turned] = x[turned] << bits | x[turned] >> (32 - bits)
    return (x + start).T.astype("<u4").ravel()


def uniforms(key, *, channel=0, frame=0, row=0, columns):
    """U of the jots of a row, in units of 2⁻⁴⁸: 16 bits by column, then 32 of a second stream."""
    stream = channel << 56 | frame << 24 | row
    first = chacha8(key, stream, -(-columns // 32)).view("<u2")[:columns]
    rest = chacha8(key, stream | 1 << 63, -(-columns // 16))[:columns]
    return first.astype(np.int64) << 32 | rest
