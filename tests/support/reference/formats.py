"""Slow twins of the readers, written for clarity: one frame at a time, or unpacked."""

import numpy as np


def packed(array):
    """Return frames of booleans (T, H, W, ...) as a photon cube."""
    return np.packbits(array, axis=2)


def encode_half_array(frames):
    """Return the bytes of SwissSPAD2, half array: row by row, the first jot in the lowest bit."""
    return np.packbits(frames, axis=2, bitorder="little").tobytes()


def encode_full_array(frames):
    """Return the bytes of SwissSPAD2, full array.

    Its halves take turns: 128 jots of a row of the top half, 128 of the mirrored row of the
    bottom half.
    """
    content = bytearray()
    for frame in frames:
        for row in range(256):
            for turn in range(4):
                columns = slice(128 * turn, 128 * turn + 128)
                content += np.packbits(frame[row, columns], bitorder="little").tobytes()
                content += np.packbits(frame[511 - row, columns], bitorder="little").tobytes()
    return bytes(content)


def encode_spad512s(frames):
    """Return the bytes of SPAD512S: frames rotated clockwise, the first jot in the highest bit."""
    return b"".join(np.packbits(np.rot90(frame, -1)).tobytes() for frame in frames)


def encode_spad512s_sparse(frames):
    """Return the bytes of SPAD512S, sparse: positions of the ones, and 262144 after each frame."""
    words = []
    for frame in frames:
        words += [*np.flatnonzero(np.rot90(frame, -1).ravel()), 262144]
    return np.array(words, "<u4").tobytes()


def oriented(array, degrees, flip):
    """Return frames (T, H, W, ...) rotated counterclockwise and then mirrored, one by one."""
    frames = []
    for frame in array:
        for _ in range(degrees // 90 % 4):
            frame = np.rot90(frame)
        if flip == "horizontal":
            frame = np.fliplr(frame)
        if flip == "vertical":
            frame = np.flipud(frame)
        frames.append(frame)
    return np.array(frames)
