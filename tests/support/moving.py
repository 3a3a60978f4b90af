"""Moving scenes whose bits are in memory, their estimated motions, and the errors of these."""

import functools

import numpy as np

import jotlight as jl


@functools.cache
def record(motion, frames=48, shape=(96, 96), photons=0.5, rng=0, **sensor):
    """Return a moving scene and its bits."""
    scene = jl.datasets.moving(
        motion=motion,
        sensor=jl.Sensor(frames=frames, **sensor),
        shape=shape,
        photons=photons,
        rng=rng,
    )
    return scene, in_memory(scene)


def in_memory(scene):
    """Return the bits of a scene, drawn only once."""
    return jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)


@functools.cache
def aligned(motion, **options):
    """Return a recorded scene, its bits, and its estimated motion. See :func:`record`."""
    scene, bits = record(motion, **options)
    return scene, bits, jl.align(bits)


def moved(shifts, **options):
    """Return a scene that shifts by rows and columns in each frame, (T, 2), and its bits."""
    scene = jl.datasets.moving(motion=np.asarray(shifts, float), **options)
    return scene, in_memory(scene)


def two_halves(velocities, frames):
    """Return the bits of a scene whose left and right halves of 96 columns move differently."""
    times = np.arange(frames) - frames // 2
    halves = [
        moved(np.outer(times, each), shape=(96, 96), photons=0.4, rng=0)[1].to_array()
        for each in velocities
    ]
    return jl.Bits.from_array(np.concatenate(halves, axis=2))


def occluded(velocities, masks, frames=32, seed=0):
    """Return the bits of planes that move by whole pixels per frame, and what each pixel shows.

    The first plane is the background, and each next one is in front of the ones before. Masks are
    those of the middle frame.
    """
    rng = np.random.default_rng(seed)
    size = masks[0].shape
    cells = -(-(size[0] + 160) // 3), -(-(size[1] + 160) // 3)
    planes = [
        rng.choice([0.1, 0.3, 0.6], cells).repeat(3, axis=0).repeat(3, axis=1) for _ in velocities
    ]
    shown = np.zeros((frames, *size), int)
    image = np.zeros((frames, *size))
    for time in range(frames):
        for index, (velocity, mask) in enumerate(zip(velocities, masks, strict=True)):
            row, column = (
                grid - (time - frames // 2) * speed
                for grid, speed in zip(np.indices(size), velocity, strict=True)
            )
            inside = (row >= 0) & (row < size[0]) & (column >= 0) & (column < size[1])
            covers = inside & mask[row.clip(0, size[0] - 1), column.clip(0, size[1] - 1)]
            if index == 0:
                covers = np.ones(size, bool)
            shown[time][covers] = index
            image[time][covers] = planes[index][row + 80, column + 80][covers]
    return jl.Bits.from_array(rng.random((frames, *size)) < image), shown


def as_burst_of(array):
    """Return an array of bits (T, H, W) as a burst."""
    from jotlight.motion.counts.burst import as_burst

    return as_burst(jl.Bits.from_array(array))


def blocks_of(bits, number=None, **options):
    """Return bits as blocks: as many as an alignment uses, or a number."""
    from jotlight.motion.counts.block_edges import block_edges
    from jotlight.motion.counts.blocks import Blocks
    from jotlight.motion.counts.burst import as_burst

    burst = as_burst(bits)
    edges = block_edges(len(burst))
    if number is not None:
        edges = np.round(np.linspace(0, len(burst), number + 1)).astype(np.intp)
    return Blocks(burst, edges, **options)


def rms_error(motion, scene, step=5):
    """Return the root mean square of the errors of a motion at visible points, in pixels."""
    errors = [
        ((motion.at(time) - scene.motion(time, at=motion.reference)) ** 2).sum(axis=0)[
            scene.visible(time, at=motion.reference)
        ]
        for time in range(0, scene.sensor.frames, step)
    ]
    return np.sqrt(np.concatenate(errors).mean() / 2)


def constant_motion(shifts, size, times, reference, model="affine"):
    """Return the motion of an image that moves by shifts (n, 2) at some times."""
    from jotlight.motion.tiles import tile_counts

    rows, columns = tile_counts(size)
    fields = 2 if model == "segments" else 1
    nodes = np.zeros((fields, len(times), 2, rows, columns), np.float32)
    nodes += np.asarray(shifts, np.float32)[None, :, :, None, None]
    information = np.zeros((fields, len(times), 3, rows, columns), np.float32)
    information[:, :, [0, 2]] = 100
    labels = np.zeros(size, np.uint8)
    return jl.Motion(nodes, labels, np.asarray(times, float), float(reference), model, information)


def track_of(blocks, velocity, reference):
    """Return the track of an image that moves by some rows and columns per frame."""
    return _track(blocks, np.outer(blocks.centers - reference, velocity), reference)


def paths_of(blocks, shifts, reference):
    """Return the paths of an image that moves by shifts (n, 2) at the centers of the blocks."""
    from jotlight.motion.displacements.track import Paths

    return Paths([_track(blocks, shifts, reference)], np.zeros(blocks.size, np.uint8))


def _track(blocks, shifts, reference):
    from jotlight.motion.displacements.track import Track
    from jotlight.motion.tiles import tile_counts

    shape, number = tile_counts(blocks.size), len(blocks.centers)
    nodes = np.zeros((number, 2, *shape)) + np.asarray(shifts)[:, :, None, None]
    information = np.zeros((number, 3, *shape))
    return Track(blocks, reference, nodes, np.ones(number, bool), information)


def total_of(paths):
    """Return the sums of all blocks along paths."""
    from jotlight.motion.counts.sums import Sums

    return Sums.total([paths.sums(block) for block in range(len(paths.blocks.centers))])


@functools.cache
def shaken():
    """Return the bits of a shaking camera, their blocks, true shifts, and the reference time."""
    scene, bits = record("shake", photons=0.4)
    blocks = blocks_of(bits)
    shifts = np.stack([scene.motion(time)[:, 0, 0] for time in blocks.centers])
    return bits, blocks, shifts, scene.reference


def film_settings(window, step=None, *, causal=True, model="auto", memory=None):
    """Return the settings of a film, with four images per window by default."""
    from jotlight.motion.films.settings import FilmSettings

    return FilmSettings(
        window=window,
        step=window // 4 if step is None else step,
        model=model,
        causal=causal,
        memory=memory,
        upsample=1,
        threads=None,
    )


@functools.cache
def photographed(motion, size, **options):
    """Return a scene of the photographs camera and astronaut, of size x size pixels."""
    return jl.datasets.moving(
        jl.datasets.photograph("camera"),
        motion,
        foreground=jl.datasets.photograph("astronaut").mean(axis=2),
        shape=(size, size),
        **options,
    )


def behind(mosaic="RGGB", motion="shake", frames=96, shape=(96, 112), rng=4):
    """Return a moving color scene behind a mosaic, and its bits."""
    scene = jl.datasets.moving(
        jl.datasets.photograph("astronaut").astype(np.float64),
        motion,
        sensor=jl.Sensor(frames=frames, mosaic=mosaic),
        shape=shape,
        photons=0.5,
        rng=rng,
    )
    return scene, in_memory(scene)


def random_counts(rng, size, trials):
    """Return random ones and trials, (H, W). A part of the pixels has no trials."""
    number = (trials * (rng.random(size) < 0.8)).astype(np.int32)
    number[size[0] // 2] = 0
    return rng.binomial(number, 0.4).astype(np.int32), number
