"""Slow twins of the motion functions of the engine, in NumPy."""

import itertools

import numpy as np
from scipy import sparse
from scipy.ndimage import correlate1d, gaussian_filter, uniform_filter
from scipy.sparse.linalg import spsolve

DERIVATIVE = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60


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


def sum_tiles(values):
    """Return the sums over tiles of 16 pixels, (..., rows, columns), of images (..., H, W)."""
    for axis in (-2, -1):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], 16), axis=axis)
    return values


def variance_per_trial(p, trials, trials_of_template):
    """Return the variance of a residual per trial, which includes the noise of the template."""
    return p * (1 - p) * (1 + 0.35 * trials / np.maximum(trials_of_template, 1))


def brightness(ones, trials, p):
    """Return the ratio of the ones to the number that a template predicts."""
    expected = (trials * p.astype(float)).sum()
    return np.clip(ones.sum() / expected, 0.1, 10) if expected > 0 else 1.0


def normal_equations(sums, probability, trials_of_template, sigma, every=False):
    """Return A (3, rows, columns) and b (2, rows, columns) of the displacement errors of tiles.

    They are sums over some rows, or over every row.
    """

    def blur(image):
        return gaussian_filter(image.astype(float), sigma, mode="reflect", truncate=3.0)

    p = blur(probability)
    rows, columns = (correlate1d(p, DERIVATIVE, axis, mode="reflect") for axis in (0, 1))
    means = np.repeat(sums.remainders / max(sums.frames, 1), 16, axis=2)[:, :, : p.shape[1]]
    ones = blur(sums.ones) / brightness(sums.ones, sums.trials, p)
    residual = ones - blur(sums.trials) * (p + rows * means[:, 0] + columns * means[:, 1])
    weight = (sums.trials > 0) / variance_per_trial(p, sums.trials, trials_of_template)
    if not every:
        weight = weight * shares_of_rows(p.shape, sigma)[:, None]
    information = weight * sums.trials * np.stack([rows * rows, rows * columns, columns * columns])
    right = weight * residual * np.stack([rows, columns])
    return sum_tiles(information), sum_tiles(right)


def shares_of_rows(size, sigma):
    """Return for how many rows of its tile each row stands, or 0 if it is not compared."""
    number = size[0]
    is_large = size[0] * size[1] >= 1 << 16
    step = next((step for step in (4, 2) if is_large and step <= 2 * sigma), 1)
    shares = np.zeros(number)
    for top in range(0, number, 16):
        tile = shares[top : top + 16]
        compared = tile[(min(step, len(tile)) - 1) // 2 :: step]
        compared[:] = len(tile) / len(compared)
    return shares


def undo_remainders(image, remainders, frames):
    """Return an image after its pixels are moved by the mean remainders, to first order."""
    means = np.repeat(remainders.astype(float) / frames, 16, axis=2)[:, :, : image.shape[1]]
    slopes = [correlate1d(image.astype(float), DERIVATIVE, axis, mode="reflect") for axis in (0, 1)]
    return image - means[:, 0] * slopes[0] - means[:, 1] * slopes[1]


def changed_remainders(remainders, change, frames):
    """Return the remainders (H, 2, columns) of counts in frames whose motion changes."""
    height = len(remainders)
    row, fraction = row_places(height, change.shape[1])
    after = np.minimum(row + 1, change.shape[1] - 1)
    rows = change[:, row] + fraction[:, None] * (change[:, after] - change[:, row])
    return remainders - frames * rows.transpose(1, 0, 2)


def row_places(height, tiles):
    """Return the tile above each row of pixels, and how far the row is from its center in tiles."""
    place = (np.arange(height) - 7.5) / 16
    row = np.clip(np.floor(place), 0, max(tiles - 2, 0)).astype(int)
    return row, place - row


def accept_agreeing(parts, p, trials_of_template, limit, block):
    """Return the ones and trials of a block where χ² of some parts is below a limit, and where."""
    ones, trials = (sum(each) for each in zip(*parts, strict=True))
    agrees = chi_squared(ones, trials, p, trials_of_template) < limit
    return block[0] * agrees, block[1] * agrees, agrees


def fit_blocks(sums, template, sigma, weights, basis, min_others):
    """Return the affine errors of blocks that are part of a template, and their information."""
    fits = []
    for each in sums:
        information, right = normal_equations(each, *template, sigma)
        others = 1 - each.trials.mean() / template[1].mean()
        fits.append(fit_affine(information, right / max(others, min_others), weights, basis))
    return [np.stack(each) for each in zip(*fits, strict=True)]


RARE = 0.02


def variances_of_sums(variance):
    """Return the variances of sums over squares of 3 pixels, of which reflection repeats some."""
    rows, columns = variance.shape
    pads = np.pad(np.arange(variance.size).reshape(rows, columns), 1, mode="symmetric")
    places = [pads[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    pairs = itertools.product(places, places)
    return sum(variance.ravel()[first] * (first == second) for first, second in pairs)


def chi_squared(ones, trials, p, trials_of_template):
    """Return χ² of each pixel, which is about 1 if the counts agree with the template."""

    def box(image, width):
        return uniform_filter(image.astype(float), width, mode="reflect") * width**2

    p, known = p.astype(float), trials > 0
    # A few ones and zeros are added to each pixel with trials, and ones to the sums of all pixels.
    rare = RARE * known
    expected, everything = trials * p + rare, trials + 2 * rare
    share = expected / np.where(known, everything, 1)
    variance = everything * variance_per_trial(share, everything, trials_of_template)
    more = RARE * p.size
    ratio_of_ones = (ones.sum() + more) / ((trials * p).sum() + more)
    residual = (ones + rare) / np.clip(ratio_of_ones, 0.1, 10) - expected
    ratio = box(residual, 3) ** 2 / np.maximum(variances_of_sums(variance), 1e-3)
    counted = trials > 0
    return (box(ratio * counted, 9) + 1) / (box(counted, 9) + 1)


def disagreement(ones, trials, other_ones, other_trials):
    """Return how much two parts of the frames disagree, (2, rows, columns of squares)."""
    first, second = ones.astype(float), other_ones.astype(float)
    weight = trials.astype(float) * other_trials
    both = weight > 0
    expected = (other_trials[both] * first[both] / trials[both]).sum()
    brightness = np.clip(expected / max(second[both].sum(), 1), 0.1, 10)

    def box(image):
        return uniform_filter(image.astype(float), 3, mode="reflect") * 9

    p = box(first + second) / np.maximum(box(trials + other_trials / brightness), 1)
    p = np.minimum(p, min(brightness, 1))
    # The variances of the two binomial numbers, whose probabilities are p and p / brightness.
    own = p * (1 - p) * variances_of_sums(weight * other_trials)
    other = brightness**2 * (p / brightness) * (1 - p / brightness)
    other = other * variances_of_sums(weight * trials)
    difference = box(first * other_trials - brightness * second * trials)
    ratio = difference**2 / np.maximum(own + other, 1e-3) * both
    sides = [range(0, length, 4) for length in ones.shape]
    return np.array(
        [
            [[image[i : i + 4, j : j + 4].sum() for j in sides[1]] for i in sides[0]]
            for image in (ratio, both)
        ]
    )


def fit_affine(information, right, weights, basis):
    """Return the affine displacement errors of a segment, and the information about them."""
    shape = weights.shape
    flat, right, weights = information.reshape(3, -1), right.reshape(2, -1), weights.ravel()
    rows, mixed, columns = flat[0] + 0.5, flat[1], flat[2] + 0.5
    cofactors = np.array([[columns, -mixed], [-mixed, rows]]) / (rows * columns - mixed**2)
    own = np.einsum("ijn,jn->in", cofactors, right)
    errors = np.zeros_like(own)
    for _ in range(5):
        x, y = own - errors
        squared = flat[0] * x**2 + 2 * flat[1] * x * y + flat[2] * y**2
        scale = max(9.0, 2 * np.median(squared[weights > 0]) if weights.any() else 0)
        trust = weights * (1 + squared / scale) ** -2.0
        a, b, c = (basis.T @ (entry * trust * basis.T).T for entry in flat)
        matrix = np.block([[a, b], [b, c]])
        vector = (right * trust @ basis).ravel()
        errors = np.linalg.solve(matrix + 1e-2 * np.eye(6), vector).reshape(2, 3) @ basis.T
    return errors.reshape(2, *shape), matrix


def nearest_affine(field, trust, basis):
    """Return the affine field, (2, tiles), that is closest to most tiles of a field."""
    weights = trust
    for _ in range(5):
        roots = np.sqrt(weights)[:, None]
        affine = (basis @ np.linalg.lstsq(basis * roots, field.T * roots, rcond=None)[0]).T
        squared = ((field - affine) ** 2).sum(axis=0)
        weights = trust / (1 + squared / max(0.25, np.median(squared))) ** 2
    return affine


def differences(shape):
    """Return the sparse matrix of the differences of all pairs of neighboring tiles."""
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    first = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    second = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    pairs = np.arange(len(first))
    size = (len(first), index.size)
    return sparse.coo_array(
        (
            np.repeat([1.0, -1.0], len(first)),
            (np.tile(pairs, 2), np.concatenate([first, second])),
        ),
        size,
    ).tocsr()


def solve_field(information, right, now, predicted, basis, smoothness):
    """Return the smooth field of displacements, (2, rows, columns), by a direct solver."""
    to_prediction, to_affine, outline = smoothness
    shape, tiles = now.shape, now[0].size
    flat, right = information.reshape(3, tiles), right.reshape(2, tiles)
    now, predicted = now.reshape(2, tiles), predicted.reshape(2, tiles)
    data = sparse.block_array(
        [[sparse.diags_array(flat[i + j]) for j in range(2)] for i in range(2)]
    )
    change = differences(shape[1:])
    field = now
    for factor in (0.1, 1.0, 1.0):
        affine = nearest_affine(field, flat[0] + flat[2] + 1e-3, basis)
        squared = ((change @ (field - affine).T) ** 2).sum(axis=1)
        weights = factor * to_affine / (1 + squared / outline**2)
        near_affine = change.T @ sparse.diags_array(weights) @ change
        near_prediction = to_prediction * change.T @ change
        smooth = near_affine + near_prediction + 1e-4 * sparse.eye_array(tiles)
        vector = data @ now.ravel() - right.ravel()
        vector += (near_affine @ affine.T + near_prediction @ predicted.T).T.ravel()
        vector += 1e-4 * predicted.ravel()
        matrix = data + sparse.block_diag([smooth, smooth])
        field = spsolve(matrix.tocsc(), vector).reshape(2, tiles)
    return field.reshape(shape)


def fast_length(length):
    """Return the smallest even number, at least `length`, without prime factors above 5."""
    rest = number = length + length % 2
    for factor in (2, 3, 5):
        while rest % factor == 0:
            rest //= factor
    return number if rest == 1 else fast_length(number + 2)


def velocity_scores(blocks, corners, size, filters, lags, line):
    """Return the scores of displacements per block in windows, (windows, m, m)."""
    rows, columns = size
    windows = np.stack([blocks[:, y : y + rows, x : x + columns] for y, x in corners])
    taper = np.hanning(rows)[:, None] * np.hanning(columns)
    height, width = (fast_length(length) for length in size)
    squared = (2 * np.pi * np.fft.fftfreq(height)[:, None]) ** 2
    squared = squared + (2 * np.pi * np.fft.rfftfreq(width)) ** 2
    fine, coarse = (np.exp(-squared * sigma**2 / 2) for sigma in filters)
    mean = windows.mean(axis=(2, 3), keepdims=True)
    spectra = np.fft.rfft2((windows - mean) * taper, s=(height, width)) * (fine - coarse)
    total = np.zeros((len(windows), len(line), len(line)))
    for lag in lags:
        cross = np.einsum("wnij,wnij->wij", np.conj(spectra[:, :-lag]), spectra[:, lag:])
        magnitude = abs(cross)
        largest = magnitude.max(axis=(1, 2), keepdims=True)
        cross /= np.sqrt(magnitude + 1e-9 * largest + 1e-30)
        correlation = np.fft.irfft2(cross, s=(height, width))
        correlation /= np.maximum(correlation.std(axis=(1, 2), keepdims=True), 1e-30)
        for axis, length in ((1, height), (2, width)):
            correlation = interpolate_periodically(correlation, lag * line, axis, length)
        total += correlation
    return total


def interpolate_periodically(values, places, axis, length):
    """Return periodic values along an axis, interpolated linearly at the places."""
    first = np.floor(places).astype(int)
    shape = [1] * values.ndim
    shape[axis] = len(places)
    fraction = (places - first).reshape(shape)
    before, after = (values.take((first + step) % length, axis=axis) for step in (0, 1))
    return before + fraction * (after - before)
