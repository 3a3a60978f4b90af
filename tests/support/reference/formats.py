"""Slow and obvious twins of the readers: one bit at a time, or whole arrays unpacked."""

import numpy as np


def packed(array):
    """Bool (T, H, W, ...) as photon cubes have it."""
    return np.packbits(array, axis=2)


def encode_half_array(frames):
    """SwissSPAD2, half array: row by row, the first jot in the lowest bit."""
    return np.packbits(frames, axis=2, bitorder="little").tobytes()


def encode_full_array(frames):
    """SwissSPAD2, full array: 128 jots of the top half, 128 of the bottom half, by turns."""
    out = bytearray()
    for frame in frames:
        for row in range(256):
            for turn in range(4):
                columns = slice(128 * turn, 128 * turn + 128)
                out += np.packbits(frame[row, columns], bitorder="little").tobytes()
                out += np.packbits(frame[511 - row, columns], bitorder="little").tobytes()
    return bytes(out)


def encode_spad512s(shown):
    """SPAD512S: what is shown, turned back clockwise, the first jot in the highest bit."""
    return b"".join(np.packbits(np.rot90(frame, -1)).tobytes() for frame in shown)


def encode_spad512s_sparse(shown):
    """SPAD512S, sparse: the places of the ones, and 262144 after each frame."""
    out = []
    for frame in shown:
        out += [*np.flatnonzero(np.rot90(frame, -1).ravel()), 262144]
    return np.array(out, "<u4").tobytes()


def turned(array, degrees, flip):
    """Frames (T, H, W, ...) turned anticlockwise and then mirrored, one by one."""
    out = []
    for frame in array:
        for _ in range(degrees // 90 % 4):
            frame = np.rot90(frame)
        if flip == "horizontal":
            frame = np.fliplr(frame)
        if flip == "vertical":
            frame = np.flipud(frame)
        out.append(frame)
    return np.array(out)
