"""Compare the classical methods with the pretrained networks on one image (section 4).

python examples/6_compare_methods.py [--quick]
"""

import sys

import jotlight as jl
from jotlight.plots import Panel, bits_panel, comparison

image = jl.datasets.photograph("coffee")
if "--quick" in sys.argv:
    image = image[100:200, 200:300]

sensor = jl.Sensor(oversampling=2, frames=4)  # 16 trials per pixel
bits = sensor.expose(image, rng=0, channel_axis=-1)
estimates = {
    "mle": jl.mle(bits, sensor),
    "noniterative": jl.noniterative(bits, sensor),
    "admm_tv": jl.admm_tv(bits, sensor),
    "network, medium": jl.pretrained(sensor).reconstruct(bits),
    "network, large": jl.pretrained(sensor, "large").reconstruct(bits),
}
panels = [Panel("photograph", "the true intensities", image), bits_panel(bits, 2)]
for name, estimate in estimates.items():
    psnr = jl.metrics.psnr(estimate, image)
    ssim = jl.metrics.ssim(estimate, image, channel_axis=-1)
    print(f"{name}: {psnr:.2f} dB, SSIM {ssim:.3f}")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB, SSIM {ssim:.3f}", estimate))
comparison(panels, f"{sensor.trials} trials per pixel").savefig("6_compare_methods.png")
