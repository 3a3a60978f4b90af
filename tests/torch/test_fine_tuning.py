"""A capture's own bits as the target: what is drawn, what is likely, and what is learned."""

import contextlib

import numpy as np
import pytest
import safetensors.numpy
from scipy import stats

import jotlight as jl

torch = pytest.importorskip("torch")

from jotlight.sensing.pixel_counts import count_pixels  # noqa: E402
from jotlight.torch import fine_tune, fine_tuning  # noqa: E402
from jotlight.torch.bit_splitting import Splits, subsample_counts  # noqa: E402
from jotlight.torch.distributed import Processes  # noqa: E402
from jotlight.torch.fine_tuning import _generator  # noqa: E402
from jotlight.training import History  # noqa: E402

SCENE = np.kron([[0.1, 0.7, 0.3], [0.9, 0.2, 0.5], [0.4, 0.8, 0.1]], np.ones((16, 16)))
SENSOR = jl.Sensor(frames=8)
BITS = SENSOR.expose(SCENE, rng=0)
TOLD = jl.Network.conditional("small", rng=0)
ONE = jl.Network.residual(SENSOR, "small", rng=0)
SHIPPED = jl.Network.initial(SENSOR, taps=5, coefficients=20)
FALSE_ALARMS = 1e-9
"""How often a test of chance fails although all is well."""


def tune(network=TOLD, data=BITS, sensor=None, **options):
    small = {"steps": 4, "batch": 2, "patch": 24, "rng": 3, "threads": 1, "device": "cpu"}
    return fine_tune(network, data, sensor, **{**small, **options})


def parameters(network):
    arrays = [array for x in network.layers for array in (x.filters, x.coefficients)]
    return np.concatenate([array.ravel() for array in arrays if array is not None])


def splits_of(network, sensor, data, seed=0):
    seen = [count_pixels(data, sensor, None)]
    return Splits(network, sensor, seen, np.random.default_rng(seed))


def test_what_is_drawn_is_hypergeometric():
    number, ones, trials, taken = 20_000, 5, 12, 7
    found = subsample_counts(
        np.full(number, ones), np.full(number, trials), np.full(number, taken), rng=0
    )
    chances = stats.hypergeom(trials, ones, taken).pmf(np.arange(ones + 1))
    often = np.bincount(found, minlength=ones + 1)
    assert len(often) == ones + 1
    for times, chance in zip(often, chances, strict=True):
        assert stats.binomtest(int(times), number, chance).pvalue > FALSE_ALARMS / (ones + 1)


def test_parts_of_binomial_bits_are_independent():
    """Given p, ones seen and ones to be told know nothing of each other."""
    number, chance = 20_000, 0.3
    ones = np.random.default_rng(1).binomial(8, chance, number)
    shown = subsample_counts(ones, np.full(number, 8), np.full(number, 5), rng=2)
    table = np.histogram2d(shown, ones - shown, bins=[np.arange(-0.5, 6), np.arange(-0.5, 4)])[0]
    expected = np.outer(
        stats.binom(5, chance).pmf(np.arange(6)), stats.binom(3, chance).pmf(np.arange(4))
    )
    for times, share in zip(table.ravel(), expected.ravel(), strict=True):
        assert stats.binomtest(int(times), number, share).pvalue > FALSE_ALARMS / table.size


@pytest.mark.parametrize("frames", [2, 3, 8, 40])
def test_every_bit_is_in_one_part(frames):
    sensor = SENSOR.replace(frames=frames)
    bits = sensor.expose(SCENE, rng=frames)
    splits = splits_of(TOLD, sensor, bits)
    (rest,), (held,) = splits.rest, splits.held_out
    kept, taken = held.planes[0, 1].numpy(), held.planes[0, 2].numpy()
    np.testing.assert_array_equal(rest[0] + kept, bits.counts())
    np.testing.assert_array_equal(rest[1] + taken, frames)
    assert (rest[0] >= 0).all()
    assert (rest[0] <= rest[1]).all()
    # A tenth of the bits: where that is no whole number, one more in some of the pixels.
    least, share = divmod(frames, 10)
    more = int(taken.sum()) - least * taken.size
    assert set(np.unique(taken)) <= {least, least + 1}
    assert stats.binomtest(more, taken.size, share / 10).pvalue > FALSE_ALARMS
    rng = np.random.default_rng(0)
    for _ in range(5):
        split = splits.draw(rng, 3, 20)
        shown, ones, trials = split.planes[:, :3].unbind(1)
        assert split.planes.shape == (3, 5, 20, 20)
        assert split.bits == split.told < frames
        assert ((ones >= 0) & (ones <= trials)).all()
        assert ((shown >= 0) & (shown <= split.bits)).all()
        assert trials.max() <= frames - 1
        assert trials.sum() > 0


def test_dead_jots_tell_nothing():
    mask = np.zeros(SCENE.shape, bool)
    mask[10:14, 20:23] = mask[40, 40] = True
    sensor = SENSOR.replace(mask=mask)
    with pytest.warns(jl.JotlightWarning, match="13 of 2304 pixels have no valid jot"):
        splits = splits_of(TOLD, sensor, sensor.expose(SCENE, rng=0))
    assert splits.held_out[0].planes[0, 2].numpy()[mask].max() == 0
    assert splits.rest[0][1][mask].max() == 0


@pytest.mark.parametrize("network", [TOLD, ONE], ids=["told", "one"])
@pytest.mark.parametrize("threshold", [1, 2])
def test_the_truth_is_the_most_likely(network, threshold):
    """The likelihood is that of the bits: with maps of dark counts and efficiency too."""
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(
        frames=200,
        gain=200.0 * threshold,
        threshold=threshold,
        dark_counts=rng.uniform(0, 0.3, SCENE.shape),
        efficiency=rng.uniform(0.3, 1, SCENE.shape),
    )
    if network is ONE:
        network = jl.Network.residual(
            sensor.replace(dark_counts=0.1, efficiency=0.6), "small", rng=0
        )
    splits = splits_of(network, sensor, sensor.expose(SCENE, rng=1))
    (held,) = splits.held_out

    def negative_log_likelihood(scene):
        picture = torch.from_numpy(scene)[None, None]
        if splits.told:
            plain = splits.sensor_at(200)
            picture = torch.from_numpy(plain.probability(scene))[None, None].double()
        return float(splits.negative_log_likelihood(picture, held))

    best = negative_log_likelihood(SCENE)
    # The entropy of the bits, to within their own noise.
    p = sensor.probability(SCENE).astype(float)
    trials = held.planes[0, 2].numpy()
    entropy = -(p * np.log(p) + (1 - p) * np.log1p(-p))
    spread = np.sqrt((trials * p * (1 - p) * np.log(p / (1 - p)) ** 2).sum()) / trials.sum()
    sigmas = stats.norm.isf(FALSE_ALARMS / 2)
    assert abs(best - (trials * entropy).sum() / trials.sum()) < sigmas * spread + 1e-4
    for other in (0.8 * SCENE, 1.2 * SCENE, SCENE + 0.1, SCENE[::-1].copy()):
        assert negative_log_likelihood(other) > best


@pytest.mark.parametrize("threshold", [1, 2])
def test_the_slope_is_that_of_differences(threshold):
    sensor = SENSOR.replace(threshold=threshold, dark_counts=np.full(SCENE.shape, 0.1))
    for network in (TOLD, jl.Network.residual(sensor.replace(dark_counts=0.1), "small", rng=0)):
        splits = splits_of(network, sensor, sensor.expose(SCENE, rng=1))
        (held,) = splits.held_out
        picture = torch.from_numpy(0.2 + 0.5 * SCENE)[None, None].requires_grad_()
        splits.negative_log_likelihood(picture, held).backward()
        way = torch.from_numpy(np.random.default_rng(0).normal(size=SCENE.shape))[None, None]
        ends = [
            float(splits.negative_log_likelihood(picture.detach() + e * way, held))
            for e in (1e-5, -1e-5)
        ]
        slope = float((picture.grad * way).sum())
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("network", [TOLD, ONE, SHIPPED], ids=["told", "one", "two-layer"])
@pytest.mark.parametrize("rate", [1e-3, 30.0])
def test_what_is_held_out_is_never_less_likely_than_at_the_start(network, rate):
    tuned, history = tune(network, rate=rate)
    assert len(history) == 5
    assert history.held_out[-1] == history.held_out.min() <= history.held_out[0]
    # The figures are those of the networks as they run without PyTorch.
    splits = Splits(network, SENSOR, [count_pixels(BITS, SENSOR, None)], _generator(3, 0))
    assert splits.held_out_negative_log_likelihood(network, 1) == history.held_out[0]
    assert splits.held_out_negative_log_likelihood(tuned, 1) == history.held_out[-1]
    if rate > 1:  # all that was tried was worse
        np.testing.assert_array_equal(parameters(tuned), parameters(network))
    assert (tuned.trials_range, tuned.sensor) == (network.trials_range, network.sensor)


@pytest.mark.parametrize(
    ("network", "gain"),
    [(TOLD, 0.5), (ONE, 0.05), (SHIPPED, 0.5)],
    ids=["told", "one", "two-layer"],
)
def test_the_picture_comes_closer_to_the_truth(network, gain):
    tuned, history = tune(network, steps=100, batch=8, patch=32, rate=3e-3)
    before, after = (jl.metrics.psnr(x.reconstruct(BITS), SCENE) for x in (network, tuned))
    assert after > before + gain
    assert history.held_out[-1] < history.held_out[0]
    assert tuned.reconstruct(BITS).max() <= 1


def test_a_seed_gives_one_network():
    one, again, other = (tune(rng=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(parameters(one[0]), parameters(again[0]))
    assert one[1].to_json() == again[1].to_json()
    assert one[0].history == again[0].history
    assert one[1].loss[0] != other[1].loss[0]
    unsaid = tune(rng=None)[0]
    said = tune(rng=unsaid.history["fine tuning"]["run"]["seed"])[0]
    np.testing.assert_array_equal(parameters(unsaid), parameters(said))


def test_bits_are_as_good_as_their_counts():
    jots = jl.Sensor(oversampling=2, frames=2)
    bits = jots.expose(SCENE, rng=0)
    one, other = tune(data=bits)[0], tune(data=bits.counts(), sensor=jots)[0]
    np.testing.assert_array_equal(parameters(one), parameters(other))


def test_the_file_keeps_how_it_was_tuned(tmp_path):
    tuned, history = tune()
    tuned.save(tmp_path / "own.safetensors")
    kept = jl.Network.load(tmp_path / "own.safetensors").history["fine tuning"]
    assert History.from_json(kept["records"]).records == history.records
    assert kept["run"]["seed"] == 3


def stopped(path, step, **options):
    """A run that Ctrl-C ended at the end of a step."""

    def stop(record):
        if record.step == step:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tune(checkpoint=path, callback=stop, **options)


@pytest.mark.parametrize("step", [0, 2, 5, 6])
@pytest.mark.parametrize("rate", [1e-3, 30.0])
def test_a_run_that_was_stopped_goes_on_as_if_it_had_not(tmp_path, step, rate):
    """Also where the best parameters lie before the stop."""
    options = {"steps": 6, "rate": rate}
    whole, history = tune(**options)
    assert rate < 1 or history.held_out[:-1].argmin() == 0
    path = tmp_path / "run"
    stopped(path, step, **options)
    told = []
    again, its = tune(**options, checkpoint=path, resume=True, callback=told.append)
    assert [record.step for record in told] == list(range(min(step + 1, 6), 7))
    assert its.records == history.records
    assert again.history == whole.history
    np.testing.assert_array_equal(parameters(again), parameters(whole))


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    path = tmp_path / "run"
    stopped(path, 1)
    other = SENSOR.expose(SCENE, rng=1)
    mapped = SENSOR.replace(dark_counts=np.full(SCENE.shape, 1e-3))
    for change, words in (
        ({"data": other}, "different capture"),
        ({"sensor": mapped}, "different capture"),
        ({"network": jl.Network.conditional("small", rng=1)}, "different network"),
        ({"rng": 4}, "seed is 3 in the file and 4 in this run"),
        ({"rate": 1e-4}, "Adam"),
    ):
        with pytest.raises(ValueError, match=words):
            tune(**change, checkpoint=path, resume=True)
    learned = tmp_path / "network"
    TOLD.save(learned)
    with pytest.raises(ValueError, match="this file is no checkpoint"):
        tune(checkpoint=learned)
    with pytest.raises(ValueError, match="resume: expected a checkpoint"):
        tune(resume=True)
    with pytest.raises(FileNotFoundError, match="no checkpoint"):
        tune(resume=True, checkpoint=tmp_path / "none")


@pytest.mark.parametrize("part", ["state.best", "state.exp_avg"])
def test_a_checkpoint_without_all_its_parts_is_refused(tmp_path, part):
    path = tmp_path / "run"
    stopped(path, 1)
    with safetensors.safe_open(path, framework="np") as kept:
        tensors = {name: kept.get_tensor(name) for name in kept.keys() if name != part}  # noqa: SIM118
        safetensors.numpy.save_file(tensors, path, kept.metadata())
    with pytest.raises(ValueError, match="damaged checkpoint: it does not fit the network"):
        tune(checkpoint=path, resume=True)


def test_processes_share_the_patches_of_a_step(monkeypatch):
    """What the gradients of two processes, one after the other, add up to."""
    losses, gradients = [], []

    class Part(Processes):
        def sum(self, tensor):
            losses.append(float(tensor[0]))
            gradients.append(tensor[1:].clone())

    for part in (Part(0, 1), Part(0, 2), Part(1, 2)):
        monkeypatch.setattr(
            fine_tuning, "together", lambda _, part=part: contextlib.nullcontext(part)
        )
        monkeypatch.setattr(Processes, "spread", lambda *_: None)
        tune(steps=1, batch=5)
    whole, one, other = range(0, 6, 2)
    assert losses[one] + losses[other] == pytest.approx(losses[whole], rel=1e-5)
    added = gradients[one] + gradients[other]
    torch.testing.assert_close(added, gradients[whole], rtol=1e-3, atol=1e-6)


def test_colours_and_maps_and_few_bits_can_be_tuned():
    colour = SENSOR.expose(np.stack([SCENE, 0.5 * SCENE], axis=-1), rng=0)
    assert tune(data=colour)[0].reconstruct(colour).shape == (*SCENE.shape, 2)
    few = SENSOR.replace(frames=2)
    assert np.isfinite(tune(data=few.expose(SCENE, rng=0))[1].loss).all()
    mask = np.zeros(SCENE.shape, bool)
    mask[:30] = True  # some patches are blind as a whole
    mask[45, 45] = True
    mapped = SENSOR.replace(mask=mask, dark_counts=np.full(SCENE.shape, 0.1))
    with pytest.warns(jl.JotlightWarning, match="no valid jot"):
        tuned = tune(data=mapped.expose(SCENE, rng=0), steps=8)
    assert np.isfinite(tuned[1].loss).all()


def test_records_are_told_as_they_come():
    told = []
    history = tune(callback=told.append)[1]
    assert told == history.records
    assert [record.step for record in told] == [0, 1, 2, 3, 4]


UNTIED = jl.Network.initial(jl.Sensor(oversampling=2), tied=False)
CUBIC = jl.Sensor(frames=8, kernel="cubic")
UNLIKE = jl.Sensor(oversampling=2, frames=2, efficiency=np.linspace(0.5, 1, 9216).reshape(96, 96))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"data": BITS[:1]}, "two bits or more.*got 1; take more frames"),
        ({"network": UNTIED, "data": UNTIED.sensor.expose(SCENE, rng=0)}, "tied"),
        (
            {"network": jl.Network.initial(CUBIC), "data": CUBIC.expose(SCENE, rng=0)},
            "box kernel, got cubic",
        ),
        ({"data": UNLIKE.expose(SCENE, rng=0)}, "inside of each pixel"),
        ({"network": ONE, "data": BITS[:4]}, "own bits per pixel"),
        ({"data": BITS.counts() + 9, "sensor": SENSOR}, "0 to K = 8"),
        ({"steps": 0}, "steps"),
        ({"batch": 0}, "batch"),
        ({"patch": 0}, "1 to the 48 pixels"),
        ({"patch": 49}, "1 to the 48 pixels"),
        ({"rate": 0}, "rate"),
        ({"rate": float("nan")}, "rate"),
        ({"rng": -1}, "rng"),
        ({"threads": 0}, "threads"),
    ],
)
def test_what_does_not_fit_is_refused(options, words):
    threads = torch.get_num_threads()
    with pytest.raises(ValueError, match=words):
        tune(**options)
    assert torch.get_num_threads() == threads
