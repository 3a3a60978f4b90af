"""A wrong number of threads is refused by every function that takes one, with what to write."""

import re

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.estimators.readings.whole_counts import diffuse
from jotlight.estimators.trial_levels import count_local_trials, local_trials
from jotlight.estimators.vst import anscombe
from jotlight.motion.films.film import film
from jotlight.motion.outlines.depth import Gain
from jotlight.networks.inference.trials_map import denoise_map
from jotlight.networks.pretrained import pretrained_conditional
from jotlight.sensing.data.pixel_counts import PixelCounts

SENSOR = jl.Sensor(frames=32)
SEVERAL = jl.Sensor(frames=4, bit_depth=4)
DIFFERENT = jl.Sensor(frames=2, gain=[2, 30])
IMAGE = jl.datasets.photograph()[100:148, 180:244]
BITS = SENSOR.expose(IMAGE, rng=0)
COUNTS = BITS.counts()
READINGS = SEVERAL.expose(IMAGE, rng=0)
COLORS = jl.Sensor(frames=4, mosaic="RGGB").expose(np.stack([IMAGE] * 3, axis=-1), rng=0)

CALLS = {
    "Sensor.expose": lambda threads: SENSOR.expose(IMAGE, rng=0, threads=threads),
    "Sensor.expose, several bits": lambda threads: SEVERAL.expose(IMAGE, rng=0, threads=threads),
    "Sensor.rate": lambda threads: SENSOR.rate(IMAGE, threads=threads),
    "Sensor.probability": lambda threads: SENSOR.probability(IMAGE, threads=threads),
    "Bits.counts": lambda threads: BITS.counts(threads=threads),
    "mle": lambda threads: jl.mle(BITS, threads=threads),
    "mle of counts": lambda threads: jl.mle(COUNTS, SENSOR, threads=threads),
    "mle of readings": lambda threads: jl.mle(READINGS, threads=threads),
    "mle of a bracket": lambda threads: jl.mle(DIFFERENT.expose(IMAGE, rng=0), threads=threads),
    "merge_readings": lambda threads: jl.merge_readings(BITS, threads=threads),
    "mle_iterative": lambda threads: jl.mle_iterative(BITS, threads=threads),
    "admm_tv": lambda threads: jl.admm_tv(COUNTS, SENSOR, threads=threads),
    "noniterative": lambda threads: jl.noniterative(BITS, threads=threads),
    "anscombe": lambda threads: anscombe(COUNTS, 32, threads=threads),
    "reconstruct": lambda threads: jl.reconstruct(BITS, threads=threads),
    "reconstruct, colors": lambda threads: jl.reconstruct(COLORS, threads=threads),
    "Network": lambda threads: jl.pretrained(SENSOR)(COUNTS, threads=threads),
    "Network of bits": lambda threads: jl.pretrained(SENSOR)(BITS, threads=threads),
    "uncertainty": lambda threads: jl.uncertainty(BITS, threads=threads),
    "compare": lambda threads: jl.compare("mle", IMAGE, SENSOR, rng=0, threads=threads),
    "calibrate": lambda threads: jl.calibrate(BITS, threads=threads),
    "align": lambda threads: jl.align(BITS, threads=threads),
    "merge": lambda threads: jl.merge(BITS, threads=threads),
    "film": lambda threads: list(film(BITS, window=16, threads=threads)),
    "train": lambda threads: jl.train(
        jl.pretrained(jl.Sensor(oversampling=4), "two-layer"), [IMAGE], rng=0, threads=threads
    ),
    "Likelihood": lambda threads: jl.Likelihood(COUNTS, 32, threads=threads),
    "spread": lambda threads: jl.operators.spread((8, 8), threads=threads),
    "differences": lambda threads: jl.operators.differences((8, 8), threads=threads),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_a_wrong_number_of_threads_is_refused(call):
    for threads in (0, -1, 1025, 2**70, 1.5, 2.0, "2", True):
        error = ValueError if type(threads) is int else TypeError
        expected = f"threads: expected a whole number from 1 to 1024, got {threads!r}; leave it out"
        with pytest.raises(error, match=re.escape(expected)):
            call(threads)


@pytest.mark.parametrize("threads", [None, 1, np.int64(2), np.uint8(3)])
@pytest.mark.parametrize("call", [CALLS["Sensor.expose"], CALLS["mle"], CALLS["reconstruct"]])
def test_numbers_of_threads_may_be_those_of_numpy(call, threads):
    assert call(threads).shape[-2:] == IMAGE.shape


BRACKET = jl.Sensor(frames=32, gain=[0.2, 1.8] * 16).expose(IMAGE, rng=0)
EFFICIENCY = np.random.default_rng(0).uniform(0.5, 1, IMAGE.shape).astype(np.float32)
UNEQUAL = SENSOR.replace(efficiency=EFFICIENCY)
MAP = np.random.default_rng(1).uniform(4, 8, (1, 8, 9))
NATS = np.random.default_rng(2).normal(0, 1, (16, 16)).astype(np.float32)

ENGINE_CALLS = {
    "admm_tv, total_variation": CALLS["admm_tv"],
    "admm_tv, likelihood_information": CALLS["admm_tv"],
    "merge, blur": CALLS["merge"],
    "merge of unequal jots, blur": lambda threads: jl.merge(
        jl.Bits(BITS.packed, BITS.width, UNEQUAL), threads=threads
    ),
    "merge of a bracket, diffuse": lambda threads: jl.merge(BRACKET, threads=threads),
    "film of a bracket, diffuse": lambda threads: list(film(BRACKET, window=32, threads=threads)),
    "causal film, disagreement": lambda threads: list(
        film(BITS, window=16, step=4, causal=True, threads=threads)
    ),
    "gain of an object, blur": lambda threads: Gain(NATS, NATS**0, threads).pixels(),
    "local_trials, local_trials": lambda threads: local_trials(MAP[0], threads=threads),
    "count_local_trials, local_trials": lambda threads: count_local_trials(
        PixelCounts(jl.Sensor(), np.ones(MAP.shape, np.int32), MAP, 1.0, 0.0, False),
        threads=threads,
    ),
    "denoise_map, local_trials": lambda threads: denoise_map(
        pretrained_conditional(SENSOR, "small"), MAP[0] / 3, MAP[0], threads=threads
    ),
    "diffuse, diffuse": lambda threads: diffuse(MAP[0], MAP[0] > 0, threads=threads),
}


@pytest.mark.parametrize("name", ENGINE_CALLS)
def test_the_number_of_threads_reaches_the_engine(monkeypatch, name):
    function, found = name.split(", ")[1], []
    run = getattr(engine, function)

    def noting(*arguments):
        found.append(arguments[-1])
        return run(*arguments)

    monkeypatch.setattr(engine, function, noting)
    ENGINE_CALLS[name](1)
    assert set(found) == {1}
