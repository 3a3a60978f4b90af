"""Slow twins of the motion functions of the engine, in NumPy."""

import numpy as np


def interpolate_tiles(nodes, tile, size):
    """Return the displacements of all pixels, (2, H, W), from those of tile centers, in float32."""
    parts = []
    for length, tiles in zip(size, nodes.shape[1:], strict=True):
        pixels = np.arange(length)
        index = np.minimum(np.maximum(pixels - tile // 2, 0) // tile, max(tiles - 2, 0))
        center = (tile * index).astype(np.float32) + np.float32((tile - 1) / 2)
        fraction = (pixels.astype(np.float32) - center) / np.float32(tile)
        parts.append((index, np.minimum(index + 1, tiles - 1), fraction))
    (above, below, rows), (left, right, columns) = parts
    samples = nodes[:, above] + rows[:, None] * (nodes[:, below] - nodes[:, above])
    return samples[:, :, left] + columns * (samples[:, :, right] - samples[:, :, left])


def shifted_counts(bits, first, last, tile, times, valid=None):
    """Return ones and trials (H, W), and the sums of the remainders (H, 2, W / 16)."""
    _, height, width = bits.shape
    rows, columns = np.indices((height, width))
    ones, trials = np.zeros((2, height, width), np.int32)
    remainders = np.zeros((height, 2, -(-width // 16)))
    if tile is not None:
        first, last = (interpolate_tiles(field, tile, (height, width)) for field in (first, last))
    valid = np.ones((height, width), bool) if valid is None else valid
    for frame, time in zip(bits, times, strict=True):
        field = first + np.float32(time) * (last - first)
        shift = np.rint(field).astype(int)
        source = rows + shift[0], columns + shift[1]
        inside = (source[0] >= 0) & (source[0] < height) & (source[1] >= 0) & (source[1] < width)
        place = tuple(np.where(inside, part, 0) for part in source)
        counted = inside & valid[place]
        ones += counted & frame[place]
        trials += counted
        remainder = shift - field.astype(np.float64)
        for block in range(remainders.shape[2]):
            mean = remainder[:, :, 16 * block : 16 * block + 16].mean(axis=2)
            remainders[:, :, block] += mean.T
    return ones, trials, remainders
