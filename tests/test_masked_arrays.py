"""No function ignores the mask of a masked array, also in a list of rows."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.layer import Layer

MASKED = np.ma.array(np.full((4, 4), 0.5), mask=np.eye(4, dtype=bool))
COUNTS = np.ma.array(np.ones((4, 4), int), mask=np.eye(4, dtype=bool))
PLAIN = np.ones((4, 4), int)
SENSOR = jl.Sensor(frames=4)
BITS = jl.Bits.from_array(np.ones((4, 4, 4), bool), SENSOR)
PIXEL = jl.FreeRunning(dead_time=0.01)
LIKELIHOOD = jl.Likelihood(PLAIN, trials=4)
SPREAD = jl.operators.spread((4, 4), 2)
MOTION = {
    "nodes": np.zeros((1, 2, 2, 1, 1), np.float32),
    "labels": np.zeros((16, 16), np.uint8),
    "times": np.array([0.0, 6.0]),
    "reference": 0.0,
    "model": "affine",
    "information": np.ones((1, 2, 3, 1, 1), np.float32),
}
CASES = {
    "dead time, mle": lambda: PIXEL.mle(COUNTS),
    "dead time, draw": lambda: PIXEL.draw(MASKED, rng=0),
    "dead time, mean": lambda: PIXEL.mean(MASKED),
    "gates": lambda: jl.gates.gate_detections(COUNTS, 4),
    "trials of gates": lambda: jl.gates.gate_detections(PLAIN, COUNTS),
    "dark counts of gates": lambda: jl.gates.gate_detections(PLAIN, 4, dark_counts=MASKED),
    "vst": lambda: jl.vst.anscombe(COUNTS, 4),
    "inverse vst": lambda: jl.vst.inverse_anscombe(MASKED, 4),
    "gaussian": lambda: jl.denoise.gaussian(MASKED),
    "nlm": lambda: jl.denoise.nlm(MASKED),
    "tv": lambda: jl.denoise.tv(MASKED),
    "total variation": lambda: jl.tv.total_variation(MASKED),
    "its weight": lambda: jl.tv.total_variation(np.ones((4, 4)), weight=MASKED),
    "likelihood": lambda: LIKELIHOOD.value(MASKED),
    "proximal": lambda: LIKELIHOOD.proximal(MASKED, 1.0, max_light=1.0),
    "weight": lambda: jl.admm_tv(PLAIN, SENSOR, weight=MASKED),
    "start of admm_tv": lambda: jl.admm_tv(PLAIN, SENSOR, start=MASKED),
    "start of mle_iterative": lambda: jl.mle_iterative(PLAIN, SENSOR, start=MASKED),
    "forward": lambda: SPREAD.forward(MASKED),
    "adjoint": lambda: SPREAD.adjoint(np.ma.ones((8, 8))),
    "layer": lambda: Layer(np.ma.ones((1, 1, 3, 3)), None),
    "nodes": lambda: jl.Motion(**{**MOTION, "nodes": np.ma.array(MOTION["nodes"])}),
    "labels": lambda: jl.Motion(**{**MOTION, "labels": np.ma.array(MOTION["labels"])}),
    "bits": lambda: jl.Bits(np.ma.array(BITS.packed), 4),
    "mask": lambda: BITS.counts(mask=np.ma.array(np.eye(4, dtype=bool))),
    "flags": lambda: jl.Merged(PLAIN, 4.0, SENSOR, flags=np.ma.zeros((4, 4), bool)),
    "rows of trials": lambda: jl.mle(PLAIN, SENSOR, trials=[*np.ma.ones((4, 4))]),
    "rows of dark counts": lambda: jl.Sensor(dark_counts=[*MASKED]),
    "rows of an image": lambda: SENSOR.expose([*MASKED], rng=0),
    "rows of counts": lambda: jl.mle([*COUNTS], SENSOR),
    "result of a denoiser": lambda: jl.noniterative(
        PLAIN, SENSOR, denoiser=lambda z: np.ma.array(z)
    ),
    "result of a function": lambda: jl.reconstruct(
        PLAIN, SENSOR, method=lambda counts: np.ma.array(counts / 4.0)
    ),
}


@pytest.mark.parametrize("run", CASES.values(), ids=CASES)
def test_masked_arrays_are_refused(run):
    with pytest.raises(TypeError, match="expected a plain array, got a masked one"):
        run()
