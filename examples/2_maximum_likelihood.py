"""Estimate each pixel by maximum likelihood, with and without calibration (section 2.2.1).

python examples/2_maximum_likelihood.py [--quick]
"""

import sys
import warnings

import numpy as np

import jotlight as jl
from jotlight.plots import Panel, comparison

image = jl.datasets.photograph("camera")
if "--quick" in sys.argv:
    image = image[100:180, 180:300]

# A camera with dark counts, 1 % hot jots, and 3 % dead jots.
rng = np.random.default_rng(0)
dark_counts = np.where(rng.random(image.shape) < 0.01, 0.5, 0.01)
dead = rng.random(image.shape) < 0.03
camera = jl.Sensor(frames=32, dark_counts=dark_counts, mask=dead)
bits = camera.expose(image, rng=1)

panels = [Panel("photograph", "the true intensities", image)]
for name, sensor in {"ideal sensor assumed": jl.Sensor(frames=32), "calibrated": camera}.items():
    with warnings.catch_warnings():
        # jotlight warns that it inpaints the dead pixels from their neighbors.
        warnings.simplefilter("ignore", jl.JotlightWarning)
        estimate = jl.mle(bits, sensor)
    psnr = jl.metrics.psnr(estimate, image)
    print(f"{name}: {psnr:.2f} dB")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB", estimate))
comparison(panels, "Maximum likelihood from 32 frames").savefig("2_maximum_likelihood.png")
