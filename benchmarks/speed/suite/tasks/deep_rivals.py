"""Other programs that run the deep networks, each in its best configuration."""

import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import jotlight as jl
from jotlight.estimators.inverse_response import intensity_from_probability
from suite.case import CannotRunError, Rival
from suite.tasks import relu_network
from suite.tasks.scene import SENSOR, bits, counts
from suite.tasks.two_layer_network import COMPILED, TORCH
from suite.threads import allowed_threads

BFLOAT16 = "jotlight, bfloat16"
CHANNELS_LAST = "PyTorch, channels-last"
COMPILED_CHANNELS_LAST = "PyTorch, compiled, channels-last"
JOTLIGHT_SPLINES = "PyTorch, with jotlight's splines"
FILTERS_BFLOAT16 = "PyTorch, compiled, filters in bfloat16"
AUTOCAST = "PyTorch, compiled, bfloat16 autocast"
CAST = "PyTorch, compiled, all in bfloat16"
RELU = "PyTorch, compiled, plain ReLU network in bfloat16"
ONNX, OPENVINO = "ONNX Runtime", "OpenVINO"
OPENVINO_BFLOAT16 = "OpenVINO, bfloat16"

SAME_RESULT = TORCH, CHANNELS_LAST, COMPILED, COMPILED_CHANNELS_LAST, ONNX, OPENVINO
"""Programs that do the same work without jotlight, with floats of 32 bits."""

PROGRAMS = (
    BFLOAT16,
    *SAME_RESULT[:4],
    JOTLIGHT_SPLINES,
    FILTERS_BFLOAT16,
    AUTOCAST,
    CAST,
    RELU,
    *SAME_RESULT[4:],
    OPENVINO_BFLOAT16,
)
"""All programs, in the order of the tables."""

Estimate = Callable[[], np.ndarray]


def rivals(network: jl.Network, multiply_adds: float) -> Sequence[Rival]:
    """Return the programs for a network with these multiply-adds per pixel."""
    last = {"channels_last": True}
    return [
        Rival(BFLOAT16, partial(in_bfloat16, network), "jotlight", rounded=True),
        Rival(TORCH, partial(eager, network), "torch"),
        Rival(CHANNELS_LAST, partial(eager, network, **last), "torch"),
        Rival(COMPILED, partial(compiled, network, "float32"), "torch"),
        Rival(COMPILED_CHANNELS_LAST, partial(compiled, network, "float32", **last), "torch"),
        Rival(JOTLIGHT_SPLINES, partial(jotlight_module, network), "torch"),
        Rival(FILTERS_BFLOAT16, partial(compiled, network, "filters"), "torch", rounded=True),
        Rival(AUTOCAST, partial(compiled, network, "autocast"), "torch", rounded=True),
        Rival(CAST, partial(compiled, network, "all"), "torch", rounded=True),
        Rival(RELU, partial(plain_relu, network, multiply_adds), "torch", same=False),
        Rival(ONNX, partial(onnx_runtime, network), "onnxruntime"),
        Rival(OPENVINO, partial(openvino, network, "f32"), "openvino"),
        Rival(OPENVINO_BFLOAT16, partial(openvino, network, "bf16"), "openvino", rounded=True),
    ]


def in_bfloat16(network: jl.Network, _: Any) -> Estimate:
    rounded = network.with_precision("bf16")
    return lambda: rounded.reconstruct(bits(), SENSOR, threads=allowed_threads())


def eager(network: jl.Network, _: Any, *, channels_last: bool = False) -> Estimate:
    from suite.torch_network import DeepNetwork

    module = DeepNetwork(network)
    module.channels_last = channels_last
    return layers_run(network, module.run_layers)


def jotlight_module(network: jl.Network, _: Any) -> Estimate:
    from jotlight.torch import Network

    return layers_run(network, Network(network).run_layers)


def compiled(
    network: jl.Network, precision: str, torch: Any, *, channels_last: bool = False
) -> Estimate:
    """Return the function from bits to an estimate by Inductor, with frozen parameters.

    Inductor stores the planes for filters with channels last by itself. `channels_last` also
    requests it for splines.
    """
    from suite.torch_network import DeepNetwork

    module = DeepNetwork(network)
    module.channels_last = channels_last
    if precision == "filters":
        module.filter_dtype = torch.bfloat16
    if precision == "all":
        module.to(torch.bfloat16)

    def layers(counts: Any, trials: int | None) -> Any:
        with torch.autocast("cpu", torch.bfloat16, enabled=precision == "autocast"):
            return module.run_layers(counts, trials).float()

    return checked(layers_run(network, compile_frozen(torch, layers)))


def plain_relu(network: jl.Network, multiply_adds: float, torch: Any) -> Estimate:
    """Return a plain network of the same cost: it shows the limit of what PyTorch can reach."""
    module = relu_network.build(torch, multiply_adds)

    def layers(counts: Any, _: int | None) -> Any:
        return module(counts.to(torch.bfloat16)).float()

    return checked(layers_run(network, compile_frozen(torch, layers)))


def compile_frozen(torch: Any, layers: Callable[..., Any]) -> Callable[..., Any]:
    # Beyond the limit, PyTorch would run without compilation and say nothing.
    torch._dynamo.config.recompile_limit = 64
    torch._dynamo.config.fail_on_recompile_limit_hit = True
    compiled: Callable[..., Any] = torch.compile(layers, dynamic=False, options={"freezing": True})
    return compiled


def checked(run: Estimate) -> Estimate:
    """Return the function, after a first call."""
    try:
        run()
    except Exception as error:
        raise CannotRunError(f"it does not run here ({type(error).__name__})") from error
    return run


def layers_run(network: jl.Network, layers: Callable[..., Any]) -> Estimate:
    """Return the function from bits to an estimate by the layers of a network in PyTorch.

    Those of a K-conditioned network return probabilities of a 1, which become intensities.
    """
    import torch

    from suite.torch_network import counts_of

    conditional = network.trials_range is not None
    trials = SENSOR.trials if conditional else None

    def run() -> np.ndarray:
        with torch.inference_mode():
            output = layers(counts_of(bits()), trials)[0, 0].numpy()
        if not conditional:
            return output
        return intensity_from_probability(output, SENSOR, allowed_threads())

    return run


def onnx_runtime(network: jl.Network, onnxruntime: Any) -> Estimate:
    def session(path: Path, threads: int) -> Callable[[np.ndarray], np.ndarray]:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        run = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"]).run
        return lambda counts: run(None, {"counts": counts})[0]

    return exported_run(network, session)


def openvino(network: jl.Network, precision: str, openvino: Any) -> Estimate:
    core = openvino.Core()

    def session(path: Path, threads: int) -> Callable[[np.ndarray], np.ndarray]:
        settings = {
            "INFERENCE_NUM_THREADS": threads,
            "INFERENCE_PRECISION_HINT": precision,
            "PERFORMANCE_HINT": "LATENCY",
        }
        model = core.compile_model(core.read_model(path), "CPU", settings)
        return lambda counts: model([counts])[0]

    return exported_run(network, session)


def exported_run(
    network: jl.Network, session: Callable[[Path, int], Callable[[np.ndarray], np.ndarray]]
) -> Estimate:
    """Return the function from bits to an estimate by the ONNX model of a network.

    A program has one session for each number of threads.
    """
    sessions: dict[int, Callable[[np.ndarray], np.ndarray]] = {}

    def run() -> np.ndarray:
        threads = allowed_threads()
        if threads not in sessions:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "network.onnx"
                network.export_onnx(path, SENSOR)
                sessions[threads] = session(path, threads)
        return sessions[threads](counts(bits())[None, None])[0, 0]

    # OpenVINO never uses more threads than there were cores for the first call.
    return checked(run)
