"""The adapters for deepinv, and its solvers on our sensor."""

import functools

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


def physics_and_data(sensor, **options):
    """Return the physics of a sensor, and random data of IMAGE."""
    physics = SensorPhysics(sensor, generator=torch.Generator().manual_seed(0), **options)
    return physics, physics(torch.from_numpy(IMAGE)[None, None])


def psnr(estimate):
    return jl.metrics.psnr(np.asarray(estimate).squeeze(), IMAGE, data_range=1.0)


@pytest.mark.parametrize("output", ["counts", "bits"])
@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_random_data_have_the_mean_of_the_forward_model(sensor, output):
    physics, y = physics_and_data(sensor, output=output)
    expected = physics.A(torch.from_numpy(IMAGE)[None, None])
    assert y.shape == expected.shape
    assert abs(y.mean() / expected.mean() - 1) < 0.05
    side = sensor.oversampling
    counts = y[0, 0] if output == "counts" else y.reshape(48, side, 48, side).sum((1, 3))
    estimate = jl.mle(counts.numpy().astype(int), sensor)
    np.testing.assert_allclose(physics.A_dagger(y)[0, 0], estimate, atol=1e-6)
    assert torch.equal(physics.A_adjoint(y), physics.A_dagger(y))


@pytest.mark.parametrize("output", ["counts", "bits"])
def test_data_of_narrow_types_have_the_estimates_of_floats(output):
    physics, y = physics_and_data(SENSOR, output=output)
    model = NetworkReconstructor(jl.Network.initial(SENSOR))
    for name in ("uint8", "float16", "bool")[: 2 if output == "counts" else 3]:
        narrow = y.to(getattr(torch, name))
        assert torch.equal(physics.A_dagger(narrow), physics.A_dagger(y))
        assert torch.equal(model(narrow, physics), model(y, physics))


def test_the_vector_jacobian_product_agrees_with_finite_differences():
    physics, _ = physics_and_data(jl.Sensor(oversampling=3, kernel="cubic", threshold=2, gain=30.0))
    rng = torch.Generator().manual_seed(1)
    x, direction = (torch.rand(1, 1, 6, 7, generator=rng, dtype=torch.float64) for _ in range(2))
    v = torch.randn(1, 1, 6, 7, generator=rng, dtype=torch.float64)
    change = (physics.A(x + 1e-6 * direction) - physics.A(x - 1e-6 * direction)) / 2e-6
    product = physics.A_vjp(x, v)
    np.testing.assert_allclose((product * direction).sum(), (v * change).sum(), rtol=1e-7)


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_the_proximal_map_minimizes_its_objective(sensor):
    physics = SensorPhysics(sensor)
    bits, light = sensor.trials, sensor.gain / sensor.trials
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


@pytest.mark.parametrize(
    "changes",
    [{"kernel": "cubic"}, {"mask": np.eye(48, dtype=bool)}, {"dark_counts": np.eye(48)}],
    ids=lambda changes: next(iter(changes)),
)
def test_the_proximal_map_of_counts_needs_jots_that_are_alike(changes):
    physics, y = physics_and_data(jl.Sensor(frames=8, **changes))
    point, fidelity = torch.full_like(y, 0.5), BitLikelihood()
    for function in (fidelity.prox, fidelity.grad, fidelity):
        with pytest.raises(ValueError, match="data: expected bits for a smooth kernel"):
            function(point, y, physics)


def test_the_proximal_map_and_the_estimate_take_whole_counts():
    physics, y = physics_and_data(SENSOR)
    point = torch.full_like(y, 0.5)
    expected = BitLikelihood().prox(point, y, physics)
    rounded = (y / 3 * 3).clamp(max=16)
    assert torch.equal(BitLikelihood().prox(point, rounded - 1e-6 * (y > 0), physics), expected)
    for function in (lambda y: BitLikelihood().prox(point, y, physics), physics.A_dagger):
        with pytest.raises(ValueError, match=r"y: expected whole numbers, got 3\.7"):
            function(torch.full_like(y, 3.7))
    with pytest.raises(ValueError, match="data: expected counts from 0 to 16, got 30 to 30"):
        BitLikelihood().prox(point, torch.full_like(y, 30.0), physics)


def test_the_proximal_map_takes_one_image_of_counts_for_several_points():
    physics, y = physics_and_data(SENSOR)
    points = torch.stack([torch.full_like(y[0], 0.2), torch.full_like(y[0], 0.7)])
    expected = [BitLikelihood().prox(point[None], y, physics, gamma=0.02) for point in points]
    found = BitLikelihood().prox(points, y, physics, gamma=0.02)
    assert torch.equal(found, torch.cat(expected))


@pytest.mark.parametrize("output", ["counts", "bits"])
def test_gradients_and_proximal_maps_exist_in_the_inference_mode(output):
    physics, y = physics_and_data(SENSOR, output=output)
    point = torch.full((1, 1, 48, 48), 0.5)
    proximal = functools.partial(BitLikelihood().prox, max_iter_inter=2)
    functions = BitLikelihood().grad, proximal
    expected = [function(point, y, physics) for function in functions]
    with torch.inference_mode():
        found = [function(point.clone(), y.clone(), physics) for function in functions]
    for each, other in zip(found, expected, strict=True):
        assert torch.equal(each, other)


def test_the_proximal_map_has_the_derivatives_of_finite_differences():
    physics, y = physics_and_data(SENSOR)
    y = y[..., :5, :6].double()
    point = physics.A_dagger(y).clamp(0.05, 0.9).requires_grad_()
    gamma = torch.tensor(0.02, dtype=torch.float64, requires_grad=True)

    def prox(x, gamma):
        return BitLikelihood().prox(x, y, physics, gamma=gamma)

    assert torch.autograd.gradcheck(prox, (point, gamma), atol=1e-4)


@pytest.mark.parametrize("output", ["counts", "bits"])
def test_the_gradient_of_the_likelihood_agrees_with_finite_differences(output):
    physics, _ = physics_and_data(SENSORS["threshold"], output=output)
    x = torch.rand(2, 1, 4, 5, dtype=torch.float64) + 0.1
    y = physics(x)
    fidelity = BitLikelihood()
    gradient = fidelity.grad(x, y, physics)
    assert fidelity(x, y, physics).shape == (2,)
    direction = torch.randn_like(x)
    values = [fidelity(x + step * direction, y, physics).sum() for step in (1e-6, -1e-6)]
    np.testing.assert_allclose(
        (gradient * direction).sum(), (values[0] - values[1]) / 2e-6, rtol=1e-6
    )


@pytest.mark.slow
@pytest.mark.parametrize("weight", [3.0, 8.0])
def test_the_admm_of_deepinv_with_total_variation_returns_our_estimate(weight):
    physics, y = physics_and_data(SENSOR)
    with torch.no_grad():
        solver = deepinv.optim.ADMM(
            data_fidelity=BitLikelihood(),
            prior=deepinv.optim.TVPrior(n_it_max=30),
            lambda_reg=weight,
            stepsize=0.02,
            max_iter=30,
        )
        estimate = solver(y, physics)
    expected = jl.admm_tv(y[0, 0].numpy().astype(int), SENSOR, weight=weight)
    assert np.sqrt(np.mean((np.asarray(estimate).squeeze() - expected) ** 2)) < 0.01
    assert abs(psnr(estimate) - psnr(expected)) < 0.1
    assert psnr(estimate) > psnr(physics.A_dagger(y)) + 3


def test_a_conditional_network_is_a_good_plug_and_play_prior():
    physics, y = physics_and_data(SENSOR)
    denoiser = NetworkDenoiser(jl.Network.conditional("small", rng=0))
    with torch.no_grad():
        solver = deepinv.optim.HQS(
            data_fidelity=BitLikelihood(),
            prior=deepinv.optim.PnP(denoiser),
            stepsize=0.02,
            sigma_denoiser=0.15,
            max_iter=6,
        )
        assert psnr(solver(y, physics)) > psnr(physics.A_dagger(y)) + 3


def test_the_denoiser_removes_noise_for_one_sigma_or_one_per_image():
    denoiser = NetworkDenoiser(jl.Network.conditional("small", rng=0))
    image = torch.from_numpy(IMAGE)[None, None]
    noisy = image + 0.2 * torch.randn(image.shape, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        denoised = denoiser(noisy, 0.2)
        both = denoiser(torch.cat([noisy, noisy]), torch.tensor([0.2, 0.05]))
        unchanged = denoiser(image, 0.0)
    assert psnr(denoised) > psnr(noisy) + 3
    torch.testing.assert_close(both[:1], denoised)
    assert not torch.equal(both[1:], denoised)
    assert psnr(unchanged) > 20
    with torch.no_grad():
        colors = denoiser(torch.cat([noisy, image, noisy], dim=1), 0.2)
    torch.testing.assert_close(colors[:, ::2], denoised.expand(1, 2, -1, -1))
    with pytest.raises(ValueError, match="network: expected a K-conditioned network"):
        NetworkDenoiser(jl.Network.initial(SENSOR))


@pytest.mark.parametrize("output", ["counts", "bits"])
@pytest.mark.parametrize("trials", [1, 16, 100, 400])
def test_the_reconstructor_returns_the_estimate_of_the_engine(trials, output):
    sensor = jl.Sensor(frames=trials)
    physics, y = physics_and_data(sensor, output=output)
    networks = [jl.pretrained(sensor)]
    if trials == 16:
        networks += [jl.Network.initial(sensor), jl.pretrained(sensor, "small")]
    counts = y.sum(dim=1)[0].numpy().astype(int)
    for network in networks:
        with torch.no_grad():
            estimate = NetworkReconstructor(network)(y, physics)
        assert psnr(estimate) == pytest.approx(psnr(network.reconstruct(counts)), abs=1e-3)


@pytest.mark.parametrize("photons", [0.05, 0.2, 0.7, 1.5, 3.0, 10.0])
@pytest.mark.parametrize("dark_counts", [0.0, 0.04])
def test_the_reconstructor_returns_the_estimate_of_the_engine_at_any_exposure(photons, dark_counts):
    sensor = jl.Sensor(frames=16, gain=photons * 16 / float(IMAGE.mean()), dark_counts=dark_counts)
    physics, y = physics_and_data(sensor)
    network = jl.pretrained(sensor)
    with torch.no_grad():
        estimate = NetworkReconstructor(network)(y, physics)
    expected = network.reconstruct(y[0, 0].numpy().astype(int))
    assert psnr(estimate) == pytest.approx(psnr(expected), abs=1e-3)


@pytest.mark.parametrize("quality", ["two-layer", "small"])
def test_the_reconstructor_takes_account_of_other_dark_counts(quality):
    sensor = jl.Sensor(frames=16, dark_counts=0.04)
    physics, y = physics_and_data(sensor)
    network = jl.pretrained(sensor, quality)
    with torch.no_grad():
        estimate = NetworkReconstructor(network)(y, physics)
    expected = network.reconstruct(y[0, 0].numpy().astype(int))
    assert psnr(estimate) == pytest.approx(psnr(expected), abs=1e-3)


def test_the_reconstructor_clips_to_the_largest_intensity():
    one = np.ones((1, 1, 1, 1), np.float32)
    for tap in (1.0, -1.0):
        layers = [jl.Layer(one, None), jl.Layer(np.float32(tap) * one, None)]
        network = jl.Network(layers, SENSOR.replace(max_intensity=0.7))
        y = torch.arange(9.0).reshape(1, 1, 3, 3)
        with torch.no_grad():
            estimate = NetworkReconstructor(network)(y, SensorPhysics(network.sensor))[0, 0].numpy()
        np.testing.assert_array_equal(estimate, network.reconstruct(y[0, 0].int().numpy()))
        assert estimate.min() == 0
        assert estimate.max() == np.float32(0.7 if tap > 0 else 0)


def test_an_unfolded_solver_has_gradients_of_its_step_size():
    physics, y = physics_and_data(SENSOR)
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
    gradients = [p.grad for name, p in solver.named_parameters() if "stepsize" in name]
    assert gradients
    assert all(torch.isfinite(gradient).all() for gradient in gradients)


def test_the_reconstructor_takes_modules_and_refuses_other_physics():
    sensor = jl.Sensor(frames=16)
    module = jl.torch.Network(jl.pretrained(sensor, "small"))
    model = NetworkReconstructor(module)
    assert model.module is module
    with pytest.raises(TypeError, match=r"expected SensorPhysics\(sensor\), got Denoising"):
        model(torch.ones((1, 1, 8, 8)), deepinv.physics.Denoising())


def test_the_denoiser_takes_modules_and_files(tmp_path):
    network = jl.Network.conditional("small", rng=0)
    network.save(tmp_path / "network.safetensors")
    module = jl.torch.Network(network)
    assert NetworkDenoiser(module).module is module
    expected = NetworkDenoiser(network)(torch.full((1, 1, 8, 8), 0.5), 0.1)
    found = NetworkDenoiser(tmp_path / "network.safetensors")(torch.full((1, 1, 8, 8), 0.5), 0.1)
    assert torch.equal(found, expected)
