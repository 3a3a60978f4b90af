"""The solvers of deepinv on our sensor."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import jotlight as jl
from reference import methods

torch = pytest.importorskip("torch")
deepinv = pytest.importorskip("deepinv")
from jotlight.torch.deepinv import (  # noqa: E402
    BitLikelihood,
    NetworkDenoiser,
    NetworkReconstructor,
    SensorPhysics,
)

IMAGE = jl.datasets.photograph("camera")[100:148, 180:228].astype(np.float32)
SENSOR = jl.Sensor(oversampling=4)
SENSORS = {
    "plain": SENSOR,
    "threshold": jl.Sensor(oversampling=3, threshold=2, gain=30.0, dark_counts=0.05),
}


def seen(sensor, **options):
    physics = SensorPhysics(sensor, generator=torch.Generator().manual_seed(0), **options)
    return physics, physics(torch.from_numpy(IMAGE)[None, None])


def quality(estimate):
    return jl.metrics.psnr(np.asarray(estimate).squeeze(), IMAGE, peak=1.0)


@pytest.mark.parametrize("output", ["counts", "bits"])
@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_the_forward_model_draws_about_what_it_expects(sensor, output):
    physics, y = seen(sensor, output=output)
    expected = physics.A(torch.from_numpy(IMAGE)[None, None])
    assert y.shape == expected.shape
    assert abs(y.mean() / expected.mean() - 1) < 0.05
    side = sensor.oversampling
    counts = y[0, 0] if output == "counts" else y.reshape(48, side, 48, side).sum((1, 3))
    estimate = jl.mle(counts.numpy().astype(int), sensor)
    np.testing.assert_allclose(physics.A_dagger(y)[0, 0], estimate, atol=1e-6)
    assert torch.equal(physics.A_adjoint(y), physics.A_dagger(y))


def test_the_derivative_of_the_forward_model_is_that_of_differences():
    physics, _ = seen(jl.Sensor(oversampling=3, kernel="cubic", threshold=2, gain=30.0))
    rng = torch.Generator().manual_seed(1)
    x, way = (torch.rand(1, 1, 6, 7, generator=rng, dtype=torch.float64) for _ in range(2))
    v = torch.randn(1, 1, 6, 7, generator=rng, dtype=torch.float64)
    change = (physics.A(x + 1e-6 * way) - physics.A(x - 1e-6 * way)) / 2e-6
    pushed = physics.A_vjp(x, v)
    np.testing.assert_allclose((pushed * way).sum(), (v * change).sum(), rtol=1e-7)


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_the_proximal_map_is_what_looking_everywhere_finds(sensor):
    physics = SensorPhysics(sensor)
    bits, light = sensor.bits_per_pixel, sensor.gain / sensor.bits_per_pixel
    counts = torch.tensor([[[[0.0, 1.0, 4.0, bits - 1.0, bits]]]]).double()
    point = torch.tensor([[[[0.3, -0.2, 0.9, 0.1, 1.4]]]]).double()
    for gamma in (1e-3, 0.05, 10.0):
        found = BitLikelihood().prox(point, counts, physics, gamma=gamma)
        for c, count, x in zip(
            *(a.flatten().tolist() for a in (found, counts, point)), strict=True
        ):

            def cost(c, count=count, x=x, gamma=gamma):
                value = methods.log_likelihood(
                    c,
                    count,
                    bits,
                    sensor.dark_counts,
                    threshold=sensor.threshold,
                    sensitivity=light,
                )
                return -gamma * value + 0.5 * (c - x) ** 2

            best = minimize_scalar(
                cost, bounds=(1e-9, 1), method="bounded", options={"xatol": 1e-10}
            )
            assert cost(max(c, 1e-9)) <= best.fun + 1e-9


def test_the_proximal_map_can_be_differentiated():
    physics, y = seen(SENSOR)
    y = y[..., :5, :6].double()
    point = physics.A_dagger(y).clamp(0.05, 0.9).requires_grad_()
    gamma = torch.tensor(0.02, dtype=torch.float64, requires_grad=True)

    def prox(x, gamma):
        return BitLikelihood().prox(x, y, physics, gamma=gamma)

    assert torch.autograd.gradcheck(prox, (point, gamma), atol=1e-4)


@pytest.mark.parametrize("output", ["counts", "bits"])
def test_the_gradient_of_the_likelihood_is_that_of_differences(output):
    physics, _ = seen(SENSORS["threshold"], output=output)
    x = torch.rand(2, 1, 4, 5, dtype=torch.float64) + 0.1
    y = physics(x)
    fidelity = BitLikelihood()
    slope = fidelity.grad(x, y, physics)
    assert fidelity(x, y, physics).shape == (2,)
    way = torch.randn_like(x)
    values = [fidelity(x + step * way, y, physics).sum() for step in (1e-6, -1e-6)]
    np.testing.assert_allclose((slope * way).sum(), (values[0] - values[1]) / 2e-6, rtol=1e-6)


@pytest.mark.parametrize("weight", [3.0, 8.0])
def test_total_variation_by_deepinvs_admm_is_ours(weight):
    physics, y = seen(SENSOR)
    with torch.no_grad():
        solver = deepinv.optim.ADMM(
            data_fidelity=BitLikelihood(),
            prior=deepinv.optim.TVPrior(n_it_max=30),
            lambda_reg=weight,
            stepsize=0.02,
            max_iter=30,
        )
        estimate = solver(y, physics)
    ours = jl.admm_tv(y[0, 0].numpy().astype(int), SENSOR, weight=weight)
    assert np.sqrt(np.mean((np.asarray(estimate).squeeze() - ours) ** 2)) < 0.01
    assert abs(quality(estimate) - quality(ours)) < 0.1
    assert quality(estimate) > quality(physics.A_dagger(y)) + 3


def test_a_network_that_is_told_k_serves_as_a_plug_and_play_prior():
    physics, y = seen(SENSOR)
    denoiser = NetworkDenoiser(jl.Network.conditional("small", rng=0))
    with torch.no_grad():
        solver = deepinv.optim.HQS(
            data_fidelity=BitLikelihood(),
            prior=deepinv.optim.PnP(denoiser),
            stepsize=0.02,
            sigma_denoiser=0.15,
            max_iter=6,
        )
        assert quality(solver(y, physics)) > quality(physics.A_dagger(y)) + 3


def test_a_denoiser_takes_noise_away():
    denoiser = NetworkDenoiser(jl.Network.conditional("small", rng=0))
    image = torch.from_numpy(IMAGE)[None, None]
    noisy = image + 0.2 * torch.randn(image.shape, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        found = denoiser(noisy, 0.2)
        both = denoiser(torch.cat([noisy, noisy]), torch.tensor([0.2, 0.05]))
        barely = denoiser(image, 0.0)
    assert quality(found) > quality(noisy) + 3
    torch.testing.assert_close(both[:1], found)
    assert not torch.equal(both[1:], found)
    assert quality(barely) > 20
    with pytest.raises(ValueError, match="network: expected a K-conditioned network"):
        NetworkDenoiser(jl.Network.initial(SENSOR))


def test_a_network_is_a_model():
    physics, y = seen(SENSOR)
    for network in (jl.Network.initial(SENSOR, sigma=1.0), jl.Network.conditional("small", rng=0)):
        with torch.no_grad():
            picture = NetworkReconstructor(network)(y, physics)
        if network.trials_range is None:
            expected = network.reconstruct(y[0, 0].numpy().astype(int))
        else:
            expected = network.conditioned_on(SENSOR).reconstruct(y[0, 0].numpy().astype(int))
        np.testing.assert_allclose(picture[0, 0], expected, atol=1e-5)


def test_an_unfolded_solver_learns_its_step():
    physics, y = seen(SENSOR)
    solver = deepinv.optim.PGD(
        data_fidelity=BitLikelihood(),
        prior=deepinv.optim.PnP(NetworkDenoiser(jl.Network.conditional("small", rng=0))),
        stepsize=0.01,
        sigma_denoiser=0.15,
        max_iter=2,
        unfold=True,
        trainable_params=["stepsize"],
    )
    estimate = solver(y, physics)
    ((estimate - torch.from_numpy(IMAGE)) ** 2).mean().backward()
    slopes = [p.grad for name, p in solver.named_parameters() if "stepsize" in name]
    assert slopes
    assert all(torch.isfinite(slope).all() for slope in slopes)
