"""Undo a smooth kernel with ADMM and total variation (section 2.2.1, reference [7]).

python examples/3_total_variation.py [--quick]
"""

import sys

import jotlight as jl
from jotlight.plots import Panel, comparison

image = jl.datasets.photograph("camera")
if "--quick" in sys.argv:
    image = image[100:180, 180:300]

sensor = jl.Sensor(oversampling=4, frames=4, kernel="cubic")
bits = sensor.expose(image, rng=0)

# With the box kernel, mle assumes that each jot receives light from its own pixel only.
box = jl.Sensor(oversampling=4, frames=4)
sharp, history = jl.admm_tv(bits, sensor, return_history=True)
estimates = {
    "mle, box kernel assumed": jl.mle(jl.Bits(bits.packed, bits.width), box),
    "admm_tv": sharp,
}
print(f"ADMM took {history.iterations} iterations")

panels = [Panel("photograph", "the true intensities", image)]
for name, estimate in estimates.items():
    psnr = jl.metrics.psnr(estimate, image)
    print(f"{name}: {psnr:.2f} dB")
    panels.append(Panel(name, f"PSNR {psnr:.2f} dB", estimate))
comparison(panels, "A cubic kernel, 64 trials per pixel").savefig("3_total_variation.png")
