"""One training step beside PyTorch's autograd, on the same network, patches and number of threads.

    python benchmarks/training_step.py [--threads 2]

The paper's setting: 128 scenes of 32 x 32, K = 16, two layers. PyTorch has to be installed beside
jotlight; it is no dependency. Both gradients are compared before anything is timed. jotlight draws
new bits in every step; so PyTorch is timed with drawing, as it would do that, and without.
"""

import argparse
import statistics
import time

import numpy as np
import torch

import jotlight as jl
from jotlight import _engine
from jotlight.training.cost import Cost
from jotlight.training.examples import Examples
from jotlight.training.parameters import engine_layers, vector_of

SENSOR = jl.Sensor(oversampling=4)
ROUNDS, TIMES = 10, 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--threads", type=int, default=2)
    threads = parser.parse_args().threads
    if _engine.DEBUG_BUILD:
        raise SystemExit("this is a debug build of jotlight; build it with --release")
    torch.set_num_threads(threads)
    scenes = jl.datasets.uniform_scene((128, 32, 32), rng=0)
    network = jl.Network.initial(SENSOR)
    examples = Examples(scenes, SENSOR, 0, 128, 32, network.halo)
    cost = Cost(network, examples, 0, 1, jl.training.SafeSet(), threads)
    vector = vector_of(network)

    # The bits of the step, as the engine draws them.
    patches = cost._batch["patches"]
    order = patches[:, 0]
    counts = drawn(cost._batch["seed"], scenes[order])
    rival = TorchNetwork(network, scenes[order], counts)
    ours = cost.gradient(vector)[1]
    theirs = rival.gradient()
    error = np.linalg.norm(ours - theirs) / np.linalg.norm(theirs)
    print(f"gradients differ by {error:.1e} of their norm\n")
    assert error < 1e-4

    # A network without filters has next to nothing to do but the drawing.
    table = jl.Network([jl.Layer(np.ones((1, 1, 1, 1)), np.zeros((1, 4)), 0.0, 16.0)], SENSOR)
    drawing = Cost(table, examples, 0, 1, jl.training.SafeSet(), threads)
    runs = {
        "jotlight, bits drawn too": lambda: cost.gradient(vector),
        "of which drawing and counting": lambda: drawing.value(vector_of(table)),
        "PyTorch, gradient alone": rival.gradient,
        "PyTorch, bits drawn too": lambda: (rival.draw(), rival.gradient()),
    }
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, run in runs.items():
            # The threads of the one before may still be waiting for more work, at full speed.
            time.sleep(0.1)
            run()
            for _ in range(TIMES):
                begun = time.perf_counter()
                run()
                seconds[name].append(time.perf_counter() - begun)
    medians = {name: statistics.median(times) for name, times in seconds.items()}
    first = medians["jotlight, bits drawn too"]
    print(f"| one step on {threads} threads, median of {ROUNDS * TIMES} | ms | ratio |")
    print("| --- | ---: | ---: |")
    for name, median in medians.items():
        print(f"| {name} | {1000 * median:.2f} | {median / first:.1f} |")
    print(f"\nPyTorch {torch.__version__}")


def drawn(seed: bytes, scenes: np.ndarray) -> np.ndarray:
    """Counts of the patches of a batch: patch i has the frames of number i."""
    counts = np.empty(scenes.shape, np.int32)
    sensor = SENSOR._engine_arguments()
    for index, scene in enumerate(scenes):
        packed = np.empty((1, 128, 16), np.uint8)
        frames, pixels = (index, index + 1), (0, 32)
        _engine.expose(sensor, scene, seed, 0, frames, pixels, pixels, packed, None)
        counts[index] = jl.Bits(packed, 128).counts(4)
    return counts


class TorchNetwork:
    """The two-layer network with its parameters as tensors."""

    def __init__(self, network: jl.Network, scenes: np.ndarray, counts: np.ndarray) -> None:
        self.scenes = torch.from_numpy(scenes)[:, None]
        self.counts = torch.from_numpy(counts.astype(np.float32))[:, None]
        (h1, w1, *self.first), (h2, w2, *self.second) = engine_layers(network, vector_of(network))
        self.parameters = [
            torch.from_numpy(array.copy()).requires_grad_() for array in (h1, w1[0], h2, w2[0])
        ]

    def draw(self) -> None:
        """Draw new bits, K of them for each pixel."""
        rates = self.scenes.expand(-1, 16, -1, -1)
        self.counts = (torch.poisson(rates) >= 1).sum(1, keepdim=True, dtype=torch.float32)

    def gradient(self) -> np.ndarray:
        h1, w1, h2, w2 = self.parameters
        u = spline(h1 * self.counts, w1, *self.first)
        # Symmetric continuation repeats the rim, which PyTorch's padding modes do not.
        mirrored = np.pad(np.arange(32), 7, mode="symmetric")
        padded = u[:, :, mirrored][:, :, :, mirrored]
        r = torch.nn.functional.conv2d(padded, h2.flip(2, 3))
        cost = 0.5 * ((spline(r, w2, *self.second) - self.scenes) ** 2).sum() / len(self.scenes)
        gradients = torch.autograd.grad(cost, self.parameters)
        return np.concatenate([gradient.numpy().ravel() for gradient in gradients])


def spline(z: torch.Tensor, w: torch.Tensor, start: float, spacing: float) -> torch.Tensor:
    place = ((z - start) / spacing).clamp(0, len(w) - 3)
    first = place.detach().floor().clamp(max=len(w) - 4).long()
    f = place - first
    g = 1 - f
    return (
        w[first] * g**3 / 6
        + w[first + 1] * (2 / 3 + 0.5 * f * f * (f - 2))
        + w[first + 2] * (2 / 3 + 0.5 * g * g * (g - 2))
        + w[first + 3] * f**3 / 6
    )


if __name__ == "__main__":
    main()
