"""Train the paper's two-layer network for a sensor of your own (section 3).

python examples/5_train_a_network.py [--quick]
"""

import sys

import jotlight as jl
from jotlight.plots import training

quick = "--quick" in sys.argv
photograph = jl.datasets.photograph("camera")[:384, :384]
patches = photograph.reshape(6, 64, 6, 64).swapaxes(1, 2).reshape(36, 64, 64)

# Intensity 1 sends a quarter of a photon to each jot in each frame. No pretrained two-layer network
# serves this sensor.
sensor = jl.Sensor(frames=20, gain=5.0)
network, history = jl.train(
    jl.Network.initial(sensor),
    patches[:30],
    steps=3 if quick else 30,
    batch=16 if quick else 128,
    rng=0,
    test=patches[30:],
)
print(f"{history.test_psnr[0]:.2f} dB before training, {history.test_psnr[-1]:.2f} dB after it")
network.save("5_train_a_network.safetensors")
training(network, history).savefig("5_train_a_network.png")
