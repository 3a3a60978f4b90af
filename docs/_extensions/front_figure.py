"""Draw the figure of the website's front page as `docs/front.jpg`.

python docs/_extensions/front_figure.py
"""

from pathlib import Path

import jotlight as jl
from jotlight.plots import Panel, bits_panel, comparison

if __name__ == "__main__":
    image = jl.datasets.photograph("camera")[64:320]
    sensor = jl.Sensor(oversampling=4)
    bits = sensor.expose(image, rng=0)
    panels = [bits_panel(bits, 4)]
    methods = {"maximum likelihood": "mle", "network, large": "network-large"}
    for title, method in methods.items():
        estimate = jl.reconstruct(bits, method=method)
        panels.append(Panel(title, f"PSNR {jl.metrics.psnr(estimate, image):.2f} dB", estimate))
    panels.append(Panel("photograph", "the true intensities", image))
    figure = comparison(panels, "16 bits per pixel")
    path = Path(__file__).parents[1] / "front.jpg"
    figure.savefig(path, dpi=80, pil_kwargs={"quality": 82, "optimize": True})
