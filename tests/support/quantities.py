"""Results of jotlight that no number of threads and no kind of process may change."""

import hashlib

import numpy as np

import jotlight as jl
from jotlight.evaluation.methods import METHODS

SENSOR = jl.Sensor(oversampling=2, frames=4)
SMOOTH = SENSOR.replace(kernel="cubic", threshold=2)
IMAGE = np.linspace(0.02, 1, 131 * 97).reshape(131, 97)
BITS = SENSOR.expose(IMAGE, rng=0, threads=1)
COUNTS = BITS.counts(2, threads=1)
SHAKEN = jl.datasets.moving(sensor=jl.Sensor(frames=32), shape=(64, 96), photons=0.5, rng=0).bits
DARK = jl.Sensor(frames=99, dark_counts=0.01).expose(0 * IMAGE, rng=0, threads=1)
JOTS = 262, 194
MASKED = SENSOR.replace(mask=np.arange(JOTS[0] * JOTS[1]).reshape(JOTS) % 7 == 0)
UNEQUAL = SENSOR.replace(dark_counts=np.linspace(0, 0.3, JOTS[0] * JOTS[1]).reshape(JOTS))


def method(name):
    """Return a function of a number of threads that runs a method."""
    options = {"tol": 0.1} if METHODS[name].iterative else {}
    return lambda threads: METHODS[name].run(BITS, SENSOR, threads=threads, **options)


def uncertainty(threads):
    result = jl.uncertainty(COUNTS, SENSOR, threads=threads, method="mle")
    return result.standard_error, result.low, result.high, result.flags()


def likelihood(threads):
    ones, light = BITS.counts(1, threads=threads), np.linspace(0.01, 2, JOTS[0] * JOTS[1])
    cells = jl.Likelihood(ones, 4, threshold=2, dark_counts=0.1, threads=threads)
    light = light.reshape(JOTS)
    return *cells.gradient_and_curvature(light), cells.information(light), cells.value(light)


def motion(threads):
    found = jl.align(SHAKEN, threads=threads)
    merged = jl.merge(SHAKEN, motion=found, threads=threads)
    return found.nodes, found.labels, found.information, merged.ones, merged.trials, merged.flags


def training(threads):
    images = jl.datasets.uniform_scene((4, 40, 40), rng=1)
    network = jl.Network.initial(SENSOR, taps=5, coefficients=20)
    trained, _ = jl.train(network, images, steps=2, batch=4, patch=24, rng=0, threads=threads)
    return [layer.filters for layer in trained.layers]


def calibration(threads):
    found = jl.calibrate(DARK, threads=threads)
    return found.dark_counts, found.hot, found.dead


def spread(threads):
    operator = jl.operators.spread((131, 97), 2, "cubic", gain=0.3, threads=threads)
    light = operator.forward(IMAGE)
    return light, operator.adjoint(light)


QUANTITIES = {
    "rate": lambda threads: SMOOTH.rate(IMAGE, threads=threads),
    "probability": lambda threads: SMOOTH.probability(IMAGE, threads=threads),
    "bits": lambda threads: SMOOTH.expose(IMAGE, rng=0, threads=threads).packed,
    "counts": lambda threads: BITS.counts(2, threads=threads),
    "counts of live jots": lambda threads: BITS.counts(2, mask=MASKED.mask, threads=threads),
    "mle of live jots": lambda threads: jl.mle(BITS, MASKED, threads=threads),
    "mle of unequal jots": lambda threads: jl.mle(BITS, UNEQUAL, threads=threads),
    "uncertainty": uncertainty,
    "likelihood": likelihood,
    "spread": spread,
    "stabilized counts": lambda threads: jl.vst.anscombe(COUNTS, 16, threads=threads),
    "inverse": lambda threads: jl.vst.inverse_anscombe(IMAGE, 16, threads=threads),
    "untied network": lambda threads: jl.Network.initial(SENSOR, tied=False).reconstruct(
        BITS, threads=threads
    ),
    "motion": motion,
    "training": training,
    "calibration": calibration,
    # The threads of BM3D's package add in a random order.
    **{name: method(name) for name in METHODS if name != "noniterative-bm3d"},
}
"""Functions of a number of threads, by name."""


def digest(name, threads=2):
    """Return the SHA-256 of a quantity."""
    found = QUANTITIES[name](threads)
    arrays = found if isinstance(found, tuple | list) else [found]
    return hashlib.sha256(b"".join(np.asarray(array).tobytes() for array in arrays)).hexdigest()


def all_digests(_=None):
    """Return the digests of all quantities, by name."""
    return {name: digest(name) for name in QUANTITIES}
