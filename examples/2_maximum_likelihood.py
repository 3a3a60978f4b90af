"""
Maximum likelihood and calibration
==================================

Maximum likelihood estimates each pixel by itself (section 2.2.1). It needs to know the dark counts
and the dead jots of the camera.
"""

import numpy as np

import jotlight as jl
from jotlight.plots import Panel, comparison

image = jl.datasets.photograph("camera")

# %%
# This camera has dark counts, 1 % hot jots, and 3 % dead jots. It records 32 frames.

rng = np.random.default_rng(0)
dark_counts = np.where(rng.random(image.shape) < 0.01, 0.5, 0.01)
dead = rng.random(image.shape) < 0.03
camera = jl.Sensor(frames=32, dark_counts=dark_counts, mask=dead)
bits = camera.expose(image, rng=1)

# %%
# The first estimate assumes an ideal sensor, and the second one uses the calibration. For the
# second one, jotlight warns that it inpaints the dead pixels from their neighbors.

panels = [Panel("photograph", "the true intensities", image)]
for name, sensor in {"ideal sensor assumed": jl.Sensor(frames=32), "calibrated": camera}.items():
    estimate = jl.mle(bits, sensor)
    psnr = jl.metrics.psnr(estimate, image)
    print(f"{name}: {psnr:.2f} dB")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB", estimate))

# %%
# The calibration removes the hot and the dead jots. The noise of the light remains.

figure = comparison(panels, "Maximum likelihood from 32 frames")
figure.savefig("2_maximum_likelihood.png")
figure
