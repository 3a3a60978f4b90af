"""
Deblurring with total variation
===============================

ADMM with total variation undoes a smooth kernel (section 2.2.1, reference [7]).
"""

import jotlight as jl
from jotlight.plots import Panel, comparison

image = jl.datasets.photograph("camera")[64:320, 96:352]

# %%
# The cubic kernel spreads the light of a pixel over the jots of its neighbors, as a lens does.

sensor = jl.Sensor(oversampling=4, frames=4, kernel="cubic")
bits = sensor.expose(image, rng=0)

# %%
# ``mle`` assumes the box kernel: each jot receives light from its own pixel only. Its estimate is
# blurred and noisy. ``admm_tv`` models the kernel, and chooses the weight of the total variation
# from the data.

box = jl.Sensor(oversampling=4, frames=4)
sharp, history = jl.admm_tv(bits, sensor, return_history=True)
print(f"ADMM took {history.iterations} iterations")
estimates = {
    "mle, box kernel assumed": jl.mle(bits, box),
    "admm_tv": sharp,
}

# %%
# The estimates beside the photograph:

panels = [Panel("photograph", "the true intensities", image)]
for name, estimate in estimates.items():
    psnr = jl.metrics.psnr(estimate, image)
    print(f"{name}: {psnr:.2f} dB")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB", estimate))
figure = comparison(panels, "A cubic kernel, 64 trials per pixel")
figure.savefig("3_total_variation.png")
figure
