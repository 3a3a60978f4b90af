"""Stabilize the variance, denoise with your own function, and invert (section 2.2.2).

python examples/4_own_denoiser.py [--quick]
"""

import sys

from scipy.ndimage import median_filter

import jotlight as jl
from jotlight.plots import Panel, comparison

image = jl.datasets.photograph("camera")
if "--quick" in sys.argv:
    image = image[100:180, 180:300]

sensor = jl.Sensor(oversampling=4)
bits = sensor.expose(image, rng=0)


def my_denoiser(z):
    """Return an image without its white noise of standard deviation 1/2 (`jl.vst.NOISE`)."""
    return median_filter(z, 5)


panels = [Panel("photograph", "the true intensities", image)]
for name, denoiser in {"gaussian": "gaussian", "tv": "tv", "median": my_denoiser}.items():
    estimate = jl.noniterative(bits, sensor, denoiser=denoiser)
    psnr = jl.metrics.psnr(estimate, image)
    print(f"{name}: {psnr:.2f} dB")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB", estimate))
comparison(panels, "Anscombe transform, denoiser, inverse").savefig("4_own_denoiser.png")
