"""The spline of PyTorch: on the engine, and in operations of PyTorch alone."""

import copy

import numpy as np
import pytest

from reference import networks

torch = pytest.importorskip("torch")
from jotlight.torch import Spline, spline  # noqa: E402
from jotlight.torch.splines import spline_reference  # noqa: E402

KNOTS = [(4, -1.0, 2.0), (9, 0.5, 0.25), (13, -3.0, 0.6), (150, 0.0, 0.1)]
SHAPES = [(1, 1, 1), (2, 3, 5, 7), (3, 2, 40, 33), (4, 3)]


def random_planes(shape, number, start, spacing, dtype, seed=0):
    """Numbers in the knots and beyond, and coefficients."""
    rng = np.random.default_rng(seed)
    reach = spacing * (number - 3)
    z = rng.uniform(start - 0.3 * reach, start + 1.3 * reach, shape)
    coefficients = rng.normal(0, 1, (shape[1], number))
    return tuple(torch.from_numpy(x).to(dtype).requires_grad_() for x in (z, coefficients))


@pytest.mark.parametrize("knots", KNOTS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("bend", [spline, spline_reference])
def test_values_are_the_twins(knots, shape, dtype, bend):
    z, coefficients = random_planes(shape, *knots, dtype)
    given = bend(z, coefficients, *knots[1:])
    assert (given.shape, given.dtype) == (z.shape, dtype)
    tolerance = 1e-12 if dtype == torch.float64 else 2e-5 * np.sqrt(knots[0])
    for channel, weights in enumerate(coefficients.detach().double().numpy()):
        one = z[:, channel].detach().double().numpy()
        expected = networks.spline(one, weights, *knots[1:])
        np.testing.assert_allclose(given[:, channel].detach(), expected, atol=tolerance)


@pytest.mark.parametrize("knots", KNOTS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_engines_gradients_are_those_of_the_formula(knots, shape, dtype):
    z, coefficients = random_planes(shape, *knots, dtype)
    weights = torch.randn(shape, dtype=dtype, generator=torch.Generator().manual_seed(1))
    slopes = [
        torch.autograd.grad((weights * bend(z, coefficients, *knots[1:])).sum(), (z, coefficients))
        for bend in (spline, spline_reference)
    ]
    tolerance = 1e-10 if dtype == torch.float64 else 2e-3
    for one, other in zip(*slopes, strict=True):
        scale = float(abs(other).max()) + 1e-6
        torch.testing.assert_close(one / scale, other / scale, atol=tolerance, rtol=0)


@pytest.mark.parametrize("knots", KNOTS[:3])
@pytest.mark.parametrize("bend", [spline, spline_reference])
def test_gradients_are_those_of_differences(knots, bend):
    z, coefficients = random_planes((2, 2, 3, 4), *knots, torch.float64)
    assert torch.autograd.gradcheck(lambda z, w: bend(z, w, *knots[1:]), (z, coefficients))


@pytest.mark.parametrize("bend", [spline, spline_reference])
def test_at_the_ends_both_ways_go_on(bend):
    """A count of 0 is on the first knot: what is there learns as its neighbours inside do."""
    start, spacing, number = 0.0, 0.5, 9
    coefficients = torch.linspace(0, 3, number, dtype=torch.float64)[None] ** 2
    inside = torch.tensor([[1e-9, 3.0 - 1e-9, -1e-9, 3.0 + 1e-9]], dtype=torch.float64).T
    exactly = torch.tensor([[0.0, 3.0]], dtype=torch.float64).T
    inside.requires_grad_()
    exactly.requires_grad_()
    near = bend(inside, coefficients, start, spacing)
    at = bend(exactly, coefficients, start, spacing)
    torch.testing.assert_close(at[:, 0], near[:2, 0], atol=1e-7, rtol=0)
    (slopes,) = torch.autograd.grad(near.sum(), inside)
    assert (slopes[2:] == 0).all()
    assert (slopes[:2] > 0).all()


def test_both_ways_agree_on_the_slope_on_knots():
    coefficients = torch.randn(1, 9, dtype=torch.float64)
    slopes = []
    for bend in (spline, spline_reference):
        knots = (0.5 * torch.arange(7, dtype=torch.float64))[:, None].requires_grad_()
        slopes.append(torch.autograd.grad(bend(knots, coefficients, 0.0, 0.5).sum(), knots)[0])
    torch.testing.assert_close(*slopes)


def test_what_is_not_a_number_leads_to_no_other_place():
    z = torch.tensor([[[float("nan"), 0.5]]])
    bent = spline_reference(z, torch.arange(7.0)[None], 0.0, 0.5)
    assert torch.isfinite(bent).tolist() == [[[False, True]]]


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_few_digits_in_are_few_digits_out(dtype):
    z, coefficients = random_planes((2, 3, 8, 9), *KNOTS[2], torch.float32)
    expected = spline(z, coefficients, *KNOTS[2][1:])
    few = z.detach().to(dtype).requires_grad_()
    given = spline(few, coefficients, *KNOTS[2][1:])
    assert given.dtype == dtype
    assert abs(given.float() - expected).mean() < 0.03
    given.float().sum().backward()
    assert few.grad.dtype == dtype
    assert coefficients.grad.dtype == torch.float32


def test_views_and_no_numbers_at_all():
    z, coefficients = random_planes((2, 3, 8, 9), *KNOTS[1], torch.float32)
    turned = z.transpose(2, 3)[:, :, ::2]
    given = spline(turned, coefficients, *KNOTS[1][1:])
    assert torch.equal(given, spline(turned.contiguous(), coefficients, *KNOTS[1][1:]))
    given.sum().backward()
    assert z.grad[..., 1::2].abs().max() == 0
    empty = spline(torch.zeros(0, 3, 4), coefficients, *KNOTS[1][1:])
    assert empty.shape == (0, 3, 4)


def test_threads_change_nothing():
    z, coefficients = random_planes((4, 5, 60, 70), *KNOTS[2], torch.float32)
    before = torch.get_num_threads()
    found = []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            out = spline(z, coefficients, *KNOTS[2][1:])
            found.append((out, *torch.autograd.grad(out.sum(), (z, coefficients))))
    finally:
        torch.set_num_threads(before)
    for one, other in zip(*found, strict=True):
        assert torch.equal(one, other)


def test_a_new_spline_is_nearly_a_rectifier():
    bend = Spline(4, coefficients=33, low=-2.0, high=2.0)
    z = torch.linspace(-3, 3, 61).expand(2, 4, 61)
    expected = z.clamp(-2, 2).clamp(min=0)
    assert abs(bend(z) - expected).max() < 0.03
    assert [x.shape for x in bend.parameters()] == [(4, 33)]
    copied = copy.deepcopy(bend)
    assert torch.equal(copied(z), bend(z))
    with torch.autocast("cpu", torch.bfloat16):
        assert abs(bend(z) - expected).max() < 0.03


def test_a_spline_compiles_into_one_graph():
    bend = Spline(3)
    torch._dynamo.reset()
    compiled = torch.compile(bend, fullgraph=True, backend="aot_eager")
    z = torch.randn(2, 3, 5, 6)
    torch.testing.assert_close(compiled(z), bend(z))


@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor that is not a leaf")
def test_the_registered_operators_are_sound():
    z, coefficients = random_planes((2, 3, 4), *KNOTS[1], torch.float64)
    torch.library.opcheck(torch.ops.jotlight.spline, (z, coefficients, *KNOTS[1][1:]))
