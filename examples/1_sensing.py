"""
The bits of four sensors
========================

A photograph exposes four sensors, whose bits look different (paper, section 2.1).
"""

import dataclasses

import jotlight as jl
from jotlight.plots import bits_panel, comparison

image = jl.datasets.photograph("camera")

# %%
# Each sensor has 4 x 4 jots per pixel. The first one reports 1 for one photon or more. The others
# need two photons, receive a quarter of the light, or have a lens that spreads the light of a pixel
# over neighboring jots.

sensors = {
    "one photon": jl.Sensor(oversampling=4),
    "two photons": jl.Sensor(oversampling=4, threshold=2),
    "dim": jl.Sensor(oversampling=4, gain=4.0),
    "cubic kernel": jl.Sensor(oversampling=4, kernel="cubic"),
}

# %%
# The model predicts the probability of a one at each jot, equation (3). Its mean agrees with the
# fraction of ones among the bits.

panels = []
for name, sensor in sensors.items():
    bits = sensor.expose(image, rng=0)
    expected = sensor.probability(image).mean()
    measured = bits.to_array().mean()
    print(f"{name}: {measured:.4f} of the bits are 1, expected {expected:.4f}")
    panels.append(dataclasses.replace(bits_panel(bits, sensor.oversampling), title=name))

# %%
# The upper row shows one jot per pixel, and the lower row shows all jots of the framed part.

figure = comparison(panels, "The bits of four sensors")
figure.savefig("1_sensing.png")
figure
