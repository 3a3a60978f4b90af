"""
Training a network
==================

The paper's network has two linear filters and two splines. Training adapts it to a sensor of your
own (section 3).
"""

import jotlight as jl
from jotlight.plots import training

# %%
# Intensity 1 sends a quarter of a photon to each jot in each frame. The pretrained networks serve
# this sensor, too. Networks that are trained for one sensor alone can be better.

sensor = jl.Sensor(frames=20, gain=5.0)

# %%
# In practice, train on many images. This example uses 36 patches of one photograph: 30 for
# training, and 6 for the test.

photograph = jl.datasets.photograph("camera")[:384, :384]
patches = photograph.reshape(6, 64, 6, 64).swapaxes(1, 2).reshape(36, 64, 64)

# %%
# Each step exposes new patches, and moves all parameters by a damped Gauss-Newton step.

network, history = jl.train(
    jl.Network.initial(sensor), patches[:30], steps=8, batch=32, rng=0, test=patches[30:]
)
print(f"{history.test_psnr[0]:.2f} dB before training, {history.test_psnr[-1]:.2f} dB after it")
network.save("5_train_a_network.safetensors")

# %%
# The upper row shows the cost, the gradient, and the tests during training. The lower row shows the
# filters and the splines, which started as the Anscombe transform and its inverse.

figure = training(network, history)
figure.savefig("5_train_a_network.png")
figure
