"""The optimizer Muon: compared with singular values, with PyTorch's Muon, and with Adam."""

import pytest

torch = pytest.importorskip("torch")

from jotlight.torch.muon import MIN_CHANNELS, Muon, is_bank, orthogonalize  # noqa: E402

RATE = 0.01


def random(*shape: int, seed: int = 0) -> "torch.Tensor":
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def after_steps(parameter, optimizer, gradients) -> "torch.Tensor":
    """Return a parameter after a step with each of the gradients."""
    for gradient in gradients:
        parameter.grad = gradient.clone()
        optimizer.step()
    return parameter.detach()


@pytest.mark.parametrize("shape", [(5, 5), (7, 40), (40, 7), (2, 3, 6, 9)])
def test_singular_vectors_remain_and_values_become_about_1(shape):
    matrices = random(*shape).double()
    left, values, right = torch.linalg.svd(matrices, full_matrices=False)
    found = left.mT @ orthogonalize(matrices) @ right.mT
    diagonal = found.diagonal(dim1=-2, dim2=-1)
    assert torch.allclose(found, torch.diag_embed(diagonal), atol=1e-6)
    # Values far below the largest one need more iterations.
    is_large = values > 0.02 * values.amax(-1, keepdim=True)
    assert bool(((diagonal > 0.65) & (diagonal < 1.25))[is_large].all())


def test_a_matrix_of_zeros_remains_one():
    assert not orthogonalize(torch.zeros(3, 6, 8)).any()


@pytest.mark.parametrize("size", [1e-18, 1e-23, 1e-30])
def test_matrices_whose_squares_underflow_become_orthogonal(size):
    # The sum of the gradients of a bank without gradients decays through these sizes.
    matrices = random(6, 8)
    assert torch.allclose(orthogonalize(size * matrices), orthogonalize(matrices), atol=1e-4)


@pytest.mark.parametrize("shape", [(6, 5, 3, 3), (30, 8, 2, 2), (8, 60, 1, 1)])
def test_banks_take_the_steps_of_pytorchs_muon(shape):
    if not hasattr(torch.optim, "Muon"):
        pytest.skip("this version of PyTorch has no Muon")
    start, gradients = random(*shape), [random(*shape, seed=seed) for seed in (1, 2, 3)]
    own = torch.nn.Parameter(start.clone())
    after_steps(own, Muon([own], lr=RATE), gradients)
    other = torch.nn.Parameter(start.flatten(1).clone())
    rival = torch.optim.Muon(
        [other], lr=RATE, weight_decay=0.0, momentum=0.95, adjust_lr_fn="match_rms_adamw"
    )
    after_steps(other, rival, [gradient.flatten(1) for gradient in gradients])
    change = (own.detach() - start).flatten()
    expected = other.detach().flatten() - start.flatten()
    # PyTorch computes in bfloat16, with 8 bits.
    assert float((change - expected).norm()) < 0.02 * float(expected.norm())


def test_each_parameter_set_is_a_matrix_of_its_own():
    start, gradient = random(4, 6, 5, 3, 3), random(4, 6, 5, 3, 3, seed=1)
    gradient[1] *= 0.25
    together = torch.nn.Parameter(start.clone())
    after_steps(together, Muon([together], lr=RATE), [gradient])
    norms = gradient.flatten(1).norm(dim=1)
    for number in range(4):
        alone = torch.nn.Parameter(start[number].clone())
        after_steps(alone, Muon([alone], lr=RATE), [gradient[number]])
        expected = (alone - start[number]) * (norms[number] / norms.max()).sqrt()
        assert torch.allclose(together[number] - start[number], expected, atol=1e-6)


def test_a_parameter_set_that_is_drawn_once_stops():
    bank = torch.nn.Parameter(torch.zeros(2, 6, 6, 3, 3))
    optimizer, places = Muon([bank], lr=RATE), []
    for step in range(400):
        bank.grad = random(2, 6, 6, 3, 3, seed=step)
        if step:
            bank.grad[1] = 0
        optimizer.step()
        places.append(bank.detach()[1].clone())
    assert float((places[-1] - places[200]).norm()) < 0.01 * float(places[200].norm())
    assert float(places[-1].square().mean().sqrt()) < 50 * 0.2 * RATE


def test_a_loaded_state_continues_the_steps():
    gradients = [random(6, 5, 3, 3, seed=seed) for seed in range(4)]
    whole = torch.nn.Parameter(torch.zeros(6, 5, 3, 3))
    after_steps(whole, Muon([whole], lr=RATE), gradients)
    part = torch.nn.Parameter(torch.zeros(6, 5, 3, 3))
    first, second = Muon([part], lr=RATE), Muon([part], lr=0.5)
    after_steps(part, first, gradients[:2])
    second.load_state_dict(first.state_dict())
    after_steps(part, second, gradients[2:])
    assert torch.equal(part, whole)


def test_groups_may_differ_in_their_learning_rates_alone():
    banks = [torch.nn.Parameter(torch.zeros(6, 6, 3, 3)) for _ in range(2)]
    optimizer = Muon([{"params": [banks[0]], "lr": RATE}, {"params": [banks[1]], "lr": 2 * RATE}])
    for bank in banks:
        bank.grad = random(6, 6, 3, 3)
    optimizer.step()
    assert torch.allclose(banks[1], 2 * banks[0])
    with pytest.raises(ValueError, match=r"weight_decay: expected groups that differ in lr alone"):
        Muon([{"params": banks, "weight_decay": 0.5}])


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_the_size_of_gradients_does_not_matter_to_banks(factor):
    gradients = [random(6, 5, 3, 3, seed=seed) for seed in (1, 2)]
    found = []
    for scale in (1.0, factor):
        bank = torch.nn.Parameter(torch.zeros(6, 5, 3, 3))
        found.append(after_steps(bank, Muon([bank], lr=RATE), [scale * each for each in gradients]))
    assert torch.allclose(*found, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("shape", [(7,), (12, 30), (6, 12, 30), (1, 1, 11, 11), (6, 24, 1, 6, 6)])
def test_other_parameters_take_the_steps_of_adam(shape):
    assert not is_bank(torch.empty(shape))
    start, gradients = random(*shape), [random(*shape, seed=seed) for seed in (1, 2, 3)]
    own, other = (torch.nn.Parameter(start.clone()) for _ in range(2))
    bank = torch.nn.Parameter(random(MIN_CHANNELS, MIN_CHANNELS, 3, 3))
    optimizer = Muon([own, bank], lr=RATE)
    bank.grad = torch.ones_like(bank)
    after_steps(own, optimizer, gradients)
    after_steps(other, torch.optim.Adam([other], lr=RATE, betas=(0.9, 0.99)), gradients)
    assert torch.equal(own, other)


def test_gradients_remain_after_a_step():
    bank, other = (torch.nn.Parameter(random(*shape)) for shape in ((6, 6, 3, 3), (4,)))
    optimizer = Muon([bank, other], lr=RATE)
    bank.grad, other.grad = (torch.ones_like(each) for each in (bank, other))
    optimizer.step()
    assert bool((bank.grad == 1).all())
    assert bool((other.grad == 1).all())


def test_parameters_without_a_gradient_do_not_change():
    bank = torch.nn.Parameter(torch.ones(6, 6, 3, 3))
    Muon([bank], lr=RATE).step()
    assert bool((bank == 1).all())


def test_closures_and_schedules_of_pytorch_work():
    bank = torch.nn.Parameter(random(6, 6, 3, 3))
    optimizer = Muon([bank], lr=RATE)
    schedule = torch.optim.lr_scheduler.StepLR(optimizer, 1, gamma=0.5)

    def closure():
        optimizer.zero_grad()
        loss = bank.square().sum()
        loss.backward()
        return loss

    before, changes = bank.detach().clone(), []
    for _ in range(2):
        loss = optimizer.step(closure).detach()
        assert float(loss) == pytest.approx(float(before.square().sum()))
        schedule.step()
        changes.append(float((bank.detach() - before).norm()))
        before = bank.detach().clone()
    assert changes[1] == pytest.approx(changes[0] / 2, rel=0.2)
