"""Expose a photograph with four sensors and look at their bits (paper, section 2.1).

python examples/1_sensing.py [--quick]
"""

import dataclasses
import sys

import jotlight as jl
from jotlight.plots import bits_panel, comparison

image = jl.datasets.photograph("camera")
if "--quick" in sys.argv:
    image = image[100:180, 180:300]

sensors = {
    "one photon": jl.Sensor(oversampling=4),
    "two photons": jl.Sensor(oversampling=4, threshold=2),
    "dim": jl.Sensor(oversampling=4, gain=4.0),
    "cubic kernel": jl.Sensor(oversampling=4, kernel="cubic"),
}
panels = []
for name, sensor in sensors.items():
    bits = sensor.expose(image, rng=0)
    expected = sensor.probability(image).mean()
    measured = bits.to_array().mean()
    print(f"{name}: {measured:.4f} of the bits are 1, expected {expected:.4f}")
    panels.append(dataclasses.replace(bits_panel(bits, sensor.oversampling), title=name))
comparison(panels, "The bits of four sensors").savefig("1_sensing.png")
