"""Planned frames of a moving scene: closed forms, and simulated scenes of the model."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.planning.planned_motion import SceneModel, plan_motion

FRAMES = np.array([1, 4, 16, 64, 256])


def field_of(scene, size, rng):
    """Return a periodic random image with the spectrum of a scene model, and this spectrum."""
    frequencies = np.meshgrid(*[np.fft.fftfreq(size)] * 2, indexing="ij")
    power = scene.spectrum(*frequencies)
    noise = np.fft.fft2(rng.normal(size=(size, size)))
    return np.fft.ifft2(np.sqrt(power) * noise).real, power, frequencies


def test_the_spectrum_is_that_of_an_exponential_correlation():
    scene = SceneModel(0.3, 6.0)
    size = 1024
    frequencies = np.meshgrid(*[np.fft.fftfreq(size)] * 2, indexing="ij")
    covariance = np.fft.ifft2(scene.spectrum(*frequencies)).real
    assert covariance[0, 0] == pytest.approx(0.09)
    distances = np.arange(2, 20)
    # Frequencies beyond half a cycle per pixel are missing, which smooths the tip at 0.
    expected = 0.09 * np.exp(-distances / 6.0)
    np.testing.assert_allclose(covariance[0, distances], expected, rtol=0.06, atol=0.001)


@pytest.mark.parametrize("frames", [4, 32])
def test_sums_of_simulated_scenes_have_the_planned_quality(frames):
    """Blur by a box, noise, and the filter that knows the noise."""
    scene, information, speed, size = SceneModel(0.25, 8.0), 3.0, 0.5, 512
    rng = np.random.default_rng(0)
    image, power, (rows, _) = field_of(scene, size, rng)
    blurred = np.fft.ifft2(np.sinc(speed * frames * rows) * np.fft.fft2(image)).real
    variance = 1 / (information * frames)
    noisy = blurred + rng.normal(0, np.sqrt(variance), image.shape)
    estimate = np.fft.ifft2(power / (power + variance) * np.fft.fft2(noisy)).real
    psnr = -10 * np.log10(np.mean((estimate - image) ** 2))
    plan = plan_motion(information, speed, (256, 256), np.array([frames]), scene)
    assert plan.summed[0] == pytest.approx(psnr, abs=0.25)


def test_short_blur_without_noise_has_its_closed_form():
    """The error is σ² v T/(6 a) for paths of some pixels, but shorter than the correlation."""
    scene = SceneModel(0.2, 40.0)
    for path in (16, 24):
        plan = plan_motion(1e9, 1.0, (256, 256), np.array([path]), scene)
        error = 10 ** (-plan.summed[0] / 10)
        assert error == pytest.approx(0.2**2 * path / (6 * 40), rel=0.12)


@pytest.mark.slow
def test_the_best_sum_is_the_best_of_all():
    plan = plan_motion(2.0, 0.3, (128, 256), np.arange(1, 200))
    assert abs(plan.best_sum - (1 + np.argmax(plan.summed))) <= 1
    assert plan.summed[150] < plan.summed[plan.best_sum] - 1


def test_at_rest_all_frames_help():
    plan = plan_motion(2.0, 0.0, (128, 128), FRAMES)
    assert (np.diff(plan.summed) > 1).all()
    np.testing.assert_allclose(plan.aligned, plan.summed)
    assert plan.registration_error == 0


@pytest.mark.slow
def test_faster_scenes_have_shorter_sums_and_more_light_too():
    sums = [plan_motion(2.0, v, (128, 128), FRAMES).best_sum for v in (0.01, 0.1, 1.0, 10.0)]
    assert all(np.diff(sums) < 0)
    light = [plan_motion(i, 0.1, (128, 128), FRAMES).best_sum for i in (0.1, 1.0, 10.0)]
    assert all(np.diff(light) < 0)


@pytest.mark.parametrize("speed", [0.3, 1.0, 3.0])
def test_the_mean_number_of_frames_in_view_is_that_of_a_count(speed):
    width = 64
    plan = plan_motion(1.0, speed, (width, 200), FRAMES)
    positions = np.arange(width) + 0.5

    def seen(frames):
        times = np.arange(frames) - (frames - 1) / 2
        places = positions + speed * times[:, None]
        return ((places > 0) & (places < width)).sum(axis=0)

    last = plan.frames_in_view
    assert seen(last).mean() == pytest.approx(seen(4 * last).mean(), rel=0.03)
    for frames in (last // 4, last // 2, last, 3 * last):
        path = min(speed * frames, 2 * width)
        share = 1 - path / (4 * width)
        assert seen(frames).mean() == pytest.approx(min(frames, last) * share, rel=0.05)
    far = plan_motion(1.0, speed, (width, 200), np.array([last, 4 * last]))
    assert far.aligned[0] == pytest.approx(far.aligned[1], abs=0.001)


def test_the_registration_error_is_that_of_the_information():
    """Oracle: displaced images of the model. The information of all frames of a path of a pixel."""
    scene, information, size = SceneModel(0.2, 10.0), 4.0, 256
    image, _, _ = field_of(scene, size, np.random.default_rng(1))
    slopes = (np.roll(image, -1, 0) - image) ** 2
    for speed in (0.1, 2.0):
        plan = plan_motion(information, speed, (size, size), FRAMES, scene)
        of_path = information * slopes.sum() / speed
        assert plan.registration_error == pytest.approx(of_path**-0.5, rel=0.15)


def test_fewer_frames_than_an_alignment_needs_are_not_recommended():
    """Each scene has much light, so that few frames are enough without this limit."""
    assert plan_motion(100.0, 8.0, (64, 64), FRAMES).best_aligned == 16  # 16 frames in view
    assert plan_motion(100.0, 8.6, (64, 64), FRAMES).best_aligned is None  # 14 frames in view
    assert plan_motion(1e6, 0.1, (64, 64), FRAMES).best_aligned == 16


@pytest.mark.slow
def test_too_little_light_cannot_be_aligned():
    assert plan_motion(1e-5, 1.0, (64, 64), FRAMES).best_aligned is None
    enough = plan_motion(1.0, 0.05, (256, 256), FRAMES)
    assert enough.best_aligned > 4 * enough.best_sum
    more = plan_motion(
        1.0, 0.05, (256, 256), np.array([enough.best_aligned, 2 * enough.best_aligned])
    )
    assert 0 <= more.aligned[1] - more.aligned[0] < 0.1


@pytest.mark.slow
def test_the_plan_takes_the_information_of_the_sensor():
    """At one level of light s, a frame of K̂² jots has K̂² s²/(exp(s) - 1) for q = 1."""
    frames = [1, 8, 64]
    for side in (1, 2):
        expected = plan_motion(side**2 * 0.3**2 / np.expm1(0.3), 0.2, (100, 80), np.array(frames))
        plan = jl.plan(
            jl.Sensor(oversampling=side), 0.3, frames=frames, speed=0.2, size=(100, 80)
        ).motion
        np.testing.assert_allclose(plan.summed, expected.summed)
        np.testing.assert_allclose(plan.aligned, expected.aligned)
        assert plan.best_sum == expected.best_sum
    assert jl.plan(jl.Sensor(), 0.3, frames=[1]).motion is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": -1.0}, "speed: expected pixels per frame from 0 to 1000, got -1"),
        ({"speed": "1"}, "speed: expected pixels per frame from 0 to 1000, got '1'"),
        ({"speed": float("nan")}, "speed: expected pixels per frame"),
        ({"speed": 1.0, "size": (0, 4)}, "size: expected at least 1, got 0"),
        ({"speed": 1.0, "size": (4, 2.5)}, "size: expected a whole number, got 2.5"),
        ({"speed": 1.0, "size": (4,)}, r"size: expected \(H, W\) in pixels, .*, got \(4,\)"),
        ({"size": 256}, r"size: expected \(H, W\) in pixels, such as \(256, 512\), got 256"),
        ({"size": "ab"}, r"size: expected \(H, W\) in pixels, .*, got 'ab'"),
    ],
)
def test_bad_input_is_refused(options, message):
    with pytest.raises((TypeError, ValueError), match=message):
        jl.plan(jl.Sensor(), 0.3, **options)
