"""Splines in PyTorch: those of the engine, and those of PyTorch operations alone."""

import copy
from functools import partial

import numpy as np
import pytest

from reference import networks

torch = pytest.importorskip("torch")
from torch.autograd import forward_ad  # noqa: E402

from jotlight.torch import Spline, spline  # noqa: E402
from jotlight.torch.splines import spline_reference  # noqa: E402

KNOTS = [(4, -1.0, 2.0), (9, 0.5, 0.25), (13, -3.0, 0.6), (150, 0.0, 0.1)]
SHAPES = [(1, 1, 1), (2, 3, 5, 7), (3, 2, 40, 33), (4, 3)]


def random_planes(shape, number, start, spacing, dtype, seed=0):
    """Return values inside and outside of the knots, and coefficients."""
    rng = np.random.default_rng(seed)
    reach = spacing * (number - 3)
    z = rng.uniform(start - 0.3 * reach, start + 1.3 * reach, shape)
    coefficients = rng.normal(0, 1, (shape[1], number))
    return tuple(torch.from_numpy(x).to(dtype).requires_grad_() for x in (z, coefficients))


@pytest.mark.parametrize("knots", KNOTS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("function", [spline, spline_reference])
def test_values_agree_with_the_twin(knots, shape, dtype, function):
    z, coefficients = random_planes(shape, *knots, dtype)
    values = function(z, coefficients, *knots[1:])
    assert (values.shape, values.dtype) == (z.shape, dtype)
    tolerance = 1e-12 if dtype == torch.float64 else 2e-5 * np.sqrt(knots[0])
    for channel, weights in enumerate(coefficients.detach().double().numpy()):
        plane = z[:, channel].detach().double().numpy()
        expected = networks.spline(plane, weights, *knots[1:])
        np.testing.assert_allclose(values[:, channel].detach(), expected, atol=tolerance)


@pytest.mark.parametrize("knots", KNOTS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_gradients_of_the_engine_agree_with_those_of_pytorch(knots, shape, dtype):
    z, coefficients = random_planes(shape, *knots, dtype)
    weights = torch.randn(shape, dtype=dtype, generator=torch.Generator().manual_seed(1))
    gradients = [
        torch.autograd.grad(
            (weights * function(z, coefficients, *knots[1:])).sum(), (z, coefficients)
        )
        for function in (spline, spline_reference)
    ]
    tolerance = 1e-10 if dtype == torch.float64 else 2e-3
    for actual, expected in zip(*gradients, strict=True):
        scale = float(abs(expected).max()) + 1e-6
        torch.testing.assert_close(actual / scale, expected / scale, atol=tolerance, rtol=0)


@pytest.mark.parametrize("knots", KNOTS[:3])
@pytest.mark.parametrize("function", [spline, spline_reference])
def test_gradients_agree_with_finite_differences(knots, function):
    z, coefficients = random_planes((2, 2, 3, 4), *knots, torch.float64)
    assert torch.autograd.gradcheck(lambda z, w: function(z, w, *knots[1:]), (z, coefficients))


@pytest.mark.parametrize("knots", KNOTS[:3])
def test_second_derivatives_agree_with_finite_differences(knots):
    z, coefficients = random_planes((2, 2, 3), *knots, torch.float64)
    assert torch.autograd.gradgradcheck(lambda z, w: spline(z, w, *knots[1:]), (z, coefficients))


def test_third_derivatives_agree_with_those_of_pytorch():
    z, coefficients = random_planes((2, 3, 5), *KNOTS[1], torch.float64)
    thirds = []
    for function in (spline, spline_reference):
        value = function(z, coefficients, *KNOTS[1][1:])
        for _ in range(3):
            (value,) = torch.autograd.grad(value.square().sum(), z, create_graph=True)
        thirds.append(value)
    assert thirds[1].abs().max() > 0
    torch.testing.assert_close(*thirds)


@pytest.mark.filterwarnings("ignore:There is a performance drop")
def test_the_transforms_of_torch_func_agree_with_those_of_pytorch_operations():
    z, coefficients = (x.detach() for x in random_planes((2, 3, 5), *KNOTS[1], torch.float64))
    results = []
    for function in (spline, spline_reference):

        def cost(z, coefficients, function=function):
            return function(z, coefficients, *KNOTS[1][1:]).square().sum()

        gradient = torch.func.grad(cost, argnums=(0, 1))
        batch = torch.stack([z, z + 0.1])
        hessian = torch.func.jacrev(torch.func.grad(cost))(z, coefficients)
        batched = torch.func.vmap(gradient, in_dims=(0, None))(batch, coefficients)
        results.append((*gradient(z, coefficients), *batched, hessian))
    torch.testing.assert_close(*results)


def cost(function, z, coefficients):
    return function(z, coefficients, *KNOTS[1][1:]).square().sum()


# PyTorch itself compiles some derivatives with it.
of_pytorch = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated")

FORWARD_MODE = {
    "jvp": lambda f, x, t: torch.func.jvp(f, x, t),
    "jvp of coefficients": lambda f, x, t: torch.func.jvp(partial(f, x[0]), x[1:], t[1:]),
    "jacfwd": lambda f, x, t: torch.func.jacfwd(f, argnums=(0, 1))(*x),
    "hessian": lambda f, x, t: torch.func.hessian(f)(*x),
    "jvp of grad": lambda f, x, t: torch.func.jvp(torch.func.grad(f), x, t),
    "vmap of jvp": lambda f, x, t: torch.func.vmap(
        lambda t: torch.func.jvp(lambda z: f(z, x[1]), x[:1], (t,))
    )(torch.stack([t[0], 2 * t[0]])),
}


@of_pytorch
@pytest.mark.parametrize("transform", FORWARD_MODE.values(), ids=FORWARD_MODE)
def test_forward_mode_derivatives_agree_with_those_of_pytorch_operations(transform):
    x = tuple(x.detach() for x in random_planes((2, 3, 5), *KNOTS[1], torch.float64))
    t = tuple(torch.randn_like(x) for x in x)
    results = [transform(partial(cost, function), x, t) for function in (spline, spline_reference)]
    torch.testing.assert_close(*results)


@of_pytorch
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float32, torch.float64])
def test_dual_numbers_agree_with_reverse_mode(dtype):
    z, coefficients = random_planes((2, 3, 5), *KNOTS[1], dtype)
    seeded = torch.Generator().manual_seed(0)
    tangents = [
        torch.randn(each.shape, generator=seeded, dtype=torch.float64).to(dtype)
        for each in (z, coefficients)
    ]
    pair = z.detach(), coefficients.detach()
    with forward_ad.dual_level():
        duals = (forward_ad.make_dual(*each) for each in zip(pair, tangents, strict=True))
        values, tangent = forward_ad.unpack_dual(spline(*duals, *KNOTS[1][1:]))
    expected = spline(z, coefficients, *KNOTS[1][1:])
    gradients = torch.autograd.grad(expected.sum(), (z, coefficients))
    assert (values.dtype, tangent.dtype) == (dtype, dtype)
    tolerance = {"atol": 0.05 if dtype == torch.bfloat16 else 1e-5, "rtol": 0.02}
    torch.testing.assert_close(values, expected.detach(), **tolerance)
    total = sum((g * t).sum() for g, t in zip(gradients, tangents, strict=True))
    is_rough = dtype == torch.bfloat16
    torch.testing.assert_close(tangent.sum(), total, atol=0.2 if is_rough else 1e-3, rtol=0.02)


@pytest.mark.parametrize("function", [spline, spline_reference])
def test_the_outermost_knots_have_the_slope_of_the_inside(function):
    """A count of 0 lies on the first knot, and has to pass its gradient on."""
    start, spacing, number = 0.0, 0.5, 9
    coefficients = torch.linspace(0, 3, number, dtype=torch.float64)[None] ** 2
    inside = torch.tensor([[1e-9, 3.0 - 1e-9, -1e-9, 3.0 + 1e-9]], dtype=torch.float64).T
    exactly = torch.tensor([[0.0, 3.0]], dtype=torch.float64).T
    inside.requires_grad_()
    exactly.requires_grad_()
    near = function(inside, coefficients, start, spacing)
    at_knots = function(exactly, coefficients, start, spacing)
    torch.testing.assert_close(at_knots[:, 0], near[:2, 0], atol=1e-7, rtol=0)
    (slopes,) = torch.autograd.grad(near.sum(), inside)
    assert (slopes[2:] == 0).all()
    assert (slopes[:2] > 0).all()


def test_engine_and_pytorch_have_the_same_slope_on_knots():
    coefficients = torch.randn(1, 9, dtype=torch.float64)
    slopes = []
    for function in (spline, spline_reference):
        knots = (0.5 * torch.arange(7, dtype=torch.float64))[:, None].requires_grad_()
        slopes.append(torch.autograd.grad(function(knots, coefficients, 0.0, 0.5).sum(), knots)[0])
    torch.testing.assert_close(*slopes)


@pytest.mark.parametrize("function", [spline, spline_reference])
def test_nan_stays_nan_and_changes_no_other_value(function):
    z = torch.tensor([[[float("nan"), 0.5, float("inf"), -float("inf")]]])
    values = function(z, torch.arange(7.0)[None], 0.0, 0.5)
    assert torch.isfinite(values).tolist() == [[[False, True, True, True]]]


def test_a_module_prints_its_knots():
    assert repr(Spline(3, 7, low=-1, high=0.5)) == "Spline(3, coefficients=7, low=-1, high=0.5)"


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_input_gets_half_precision_output_and_gradient(dtype):
    z, coefficients = random_planes((2, 3, 8, 9), *KNOTS[2], torch.float32)
    expected = spline(z, coefficients, *KNOTS[2][1:])
    half = z.detach().to(dtype).requires_grad_()
    values = spline(half, coefficients, *KNOTS[2][1:])
    assert values.dtype == dtype
    assert abs(values.float() - expected).mean() < 0.03
    values.float().sum().backward()
    assert half.grad.dtype == dtype
    assert coefficients.grad.dtype == torch.float32


def test_views_and_empty_tensors_are_valid_input():
    z, coefficients = random_planes((2, 3, 8, 9), *KNOTS[1], torch.float32)
    view = z.transpose(2, 3)[:, :, ::2]
    values = spline(view, coefficients, *KNOTS[1][1:])
    assert torch.equal(values, spline(view.contiguous(), coefficients, *KNOTS[1][1:]))
    values.sum().backward()
    assert z.grad[..., 1::2].abs().max() == 0
    empty = spline(torch.zeros(0, 3, 4), coefficients, *KNOTS[1][1:])
    assert empty.shape == (0, 3, 4)


def test_the_number_of_threads_does_not_change_any_value():
    z, coefficients = random_planes((4, 5, 60, 70), *KNOTS[2], torch.float32)
    before = torch.get_num_threads()
    results = []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            out = spline(z, coefficients, *KNOTS[2][1:])
            results.append((out, *torch.autograd.grad(out.sum(), (z, coefficients))))
    finally:
        torch.set_num_threads(before)
    for single, double in zip(*results, strict=True):
        assert torch.equal(single, double)


def test_a_new_spline_is_nearly_relu_and_keeps_its_values_in_a_copy():
    module = Spline(4, coefficients=33, low=-2.0, high=2.0)
    z = torch.linspace(-3, 3, 61).expand(2, 4, 61)
    expected = z.clamp(-2, 2).clamp(min=0)
    assert abs(module(z) - expected).max() < 0.03
    assert [x.shape for x in module.parameters()] == [(4, 33)]
    copied = copy.deepcopy(module)
    assert torch.equal(copied(z), module(z))
    with torch.autocast("cpu", torch.bfloat16):
        assert abs(module(z) - expected).max() < 0.03


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((2, 3), "coefficients: expected at least 4, got 3"),
        ((0,), "channels: expected at least 1, got 0"),
        ((2, 9, 1.0, 1.0), "low, high: expected low below high, got 1.0 and 1.0"),
    ],
)
def test_a_module_refuses_arguments_without_a_spline(arguments, message):
    with pytest.raises(ValueError, match=message):
        Spline(*arguments)


def test_the_state_of_a_module_with_other_knots_is_refused():
    module = Spline(2)
    module.load_state_dict(Spline(2).half().state_dict())
    with pytest.raises(ValueError, match=r"layer 0, got knots from -2 in steps of 0\.4; create"):
        module.load_state_dict(Spline(2, low=-2.0, high=2.0).state_dict())


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::torch.jit.TracerWarning")
def test_pytorch_exports_a_module_with_splines_to_onnx(tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    module = torch.nn.Sequential(torch.nn.Conv2d(1, 3, 3), Spline(3))
    z, path = torch.randn(1, 1, 6, 7), str(tmp_path / "model.onnx")
    torch.onnx.export(module, (z,), path, dynamo=False, input_names=["z"])
    (values,) = onnxruntime.InferenceSession(path).run(None, {"z": z.numpy()})
    torch.testing.assert_close(torch.from_numpy(values), module(z).detach())


@pytest.mark.parametrize("device", ["cpu", "meta"])
@pytest.mark.parametrize(
    ("error", "message", "shape", "dtype", "own_shape", "spacing"),
    [
        (ValueError, r"z: .* got \(5,\); .*, write z\.reshape\(-1, 1\)", (5,), None, (1, 4), 1.0),
        (ValueError, r"z: expected shape \(N, C, \.\.\.\), got \(\);", (), None, (1, 4), 1.0),
        (TypeError, "z: expected floats, got torch.int64;", (5, 1), torch.int64, (1, 4), 1.0),
        (TypeError, "z: expected floats, got torch.c.*64;", (5, 1), torch.complex64, (1, 4), 1.0),
        (ValueError, r"coefficients: .* C = 3 .* got \(3, 3\)", (2, 3, 4), None, (3, 3), 1.0),
        (ValueError, r"coefficients: .* C = 3 .* got \(2, 5\)", (2, 3, 4), None, (2, 5), 1.0),
        (ValueError, r"coefficients: .* C = 3 .* got \(5,\)", (2, 3, 4), None, (5,), 1.0),
        (ValueError, r"spacing: expected a distance above 0, got 0\.0", (2, 1), None, (1, 4), 0.0),
    ],
)
def test_all_devices_refuse_the_same_input(
    device, error, message, shape, dtype, own_shape, spacing
):
    z = torch.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(error, match=message):
        spline(z, torch.zeros(own_shape, device=device), 0.0, spacing)


def test_whole_coefficients_are_refused_and_advice_for_one_channel_works():
    coefficients = torch.tensor([[-1, 0, 1, 2]])
    with pytest.raises(TypeError, match=r"coefficients: expected floats, got torch\.int64"):
        spline(torch.zeros(2, 1), coefficients, 0.0, 1.0)
    values = spline(torch.tensor([0.25, 0.5]).reshape(-1, 1), coefficients.float(), 0.0, 1.0)
    assert values.flatten().tolist() == [0.25, 0.5]


@pytest.mark.slow
def test_a_spline_compiles_into_one_graph():
    module = Spline(3)
    torch._dynamo.reset()
    compiled = torch.compile(module, fullgraph=True, backend="aot_eager")
    z = torch.randn(2, 3, 5, 6)
    torch.testing.assert_close(compiled(z), module(z))


@of_pytorch
@pytest.mark.slow
def test_compiled_forward_mode_derivatives_are_those_of_pytorch_operations():
    x = tuple(x.detach() for x in random_planes((2, 3, 5), *KNOTS[1], torch.float64))

    def derivative(function):
        return torch.func.jvp(lambda *x: function(*x, *KNOTS[1][1:]), x, x)

    torch._dynamo.reset()
    compiled = torch.compile(derivative, backend="aot_eager")
    torch.testing.assert_close(compiled(spline), derivative(spline_reference))


@pytest.mark.slow
def test_the_registered_operator_passes_the_checks_of_pytorch():
    z, coefficients = random_planes((2, 3, 4), *KNOTS[1], torch.float64)
    arguments = z.detach(), coefficients.detach(), *KNOTS[1][1:]
    torch.library.opcheck(torch.ops.jotlight.spline, arguments)
