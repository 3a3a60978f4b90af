"""
A denoiser of your own
======================

The non-iterative method makes the noise of the counts equally strong everywhere, calls a denoiser,
and inverts the transform (section 2.2.2). The denoiser can be your own function.
"""

from scipy.ndimage import median_filter

import jotlight as jl
from jotlight.plots import Panel, comparison

image = jl.datasets.photograph("camera")
sensor = jl.Sensor(oversampling=4)
bits = sensor.expose(image, rng=0)

# %%
# A denoiser maps an image to an image. The noise of its input is white, with the standard deviation
# 1/2 (``jl.vst.NOISE``) at every brightness, and less where nearly all bits are equal.


def my_denoiser(z):
    """Return the median of 5 x 5 pixels around each pixel."""
    return median_filter(z, 5)


# %%
# Two denoisers of jotlight and your own one:

panels = [Panel("photograph", "the true intensities", image)]
for name, denoiser in {"gaussian": "gaussian", "tv": "tv", "median": my_denoiser}.items():
    estimate = jl.noniterative(bits, sensor, denoiser=denoiser)
    psnr = jl.metrics.psnr(estimate, image)
    print(f"{name}: {psnr:.2f} dB")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB", estimate))
figure = comparison(panels, "Anscombe transform, denoiser, inverse")
figure.savefig("4_own_denoiser.png")
figure
