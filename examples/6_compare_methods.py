"""
All kinds of methods compared
=============================

The classical methods and the pretrained networks estimate the same photograph (section 4).
"""

import jotlight as jl
from jotlight.plots import Panel, bits_panel, comparison

image = jl.datasets.photograph("coffee")[:256, 120:440]

# %%
# The sensor sees each color channel of a pixel 16 times: 2 x 2 jots in 4 frames.

sensor = jl.Sensor(oversampling=2, frames=4)
bits = sensor.expose(image, rng=0, channel_axis=-1)

# %%
# Each method is a function of the bits. A pretrained network is an object that reconstructs.

estimates = {
    "mle": jl.mle(bits, sensor),
    "noniterative": jl.noniterative(bits, sensor),
    "admm_tv": jl.admm_tv(bits, sensor),
    "network, medium": jl.pretrained(sensor).reconstruct(bits),
    "network, large": jl.pretrained(sensor, "large").reconstruct(bits),
}

# %%
# PSNR and SSIM compare the estimates with the photograph. On the page of results, the same methods
# run on 100 photographs.

panels = [Panel("photograph", "the true intensities", image), bits_panel(bits, 2)]
for name, estimate in estimates.items():
    psnr = jl.metrics.psnr(estimate, image)
    ssim = jl.metrics.ssim(estimate, image, channel_axis=-1)
    print(f"{name}: {psnr:.2f} dB, SSIM {ssim:.3f}")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB, SSIM {ssim:.3f}", estimate))
figure = comparison(panels, f"{sensor.trials} trials per pixel")
figure.savefig("6_compare_methods.png")
figure
