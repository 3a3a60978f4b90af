"""Sources of training patches."""

import numpy as np
import pytest
from scipy.stats import binom

from jotlight.training import (
    GeneratedPatches,
    ImagePatches,
    PatchMixture,
    PhotographPatches,
    SyntheticPatches,
)
from jotlight.training.patch_sources import apply_symmetry, as_patch_source

IMAGE = np.random.default_rng(0).random((7, 9), np.float32)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_patches_of_images_are_all_rotated_and_mirrored_cutouts():
    source = ImagePatches([IMAGE])
    cutouts = {
        apply_symmetry(IMAGE[y : y + 5, x : x + 5], symmetry).tobytes()
        for y in range(3)
        for x in range(5)
        for symmetry in range(8)
    }
    generator = rng()
    drawn = [source.draw(generator, 5) for _ in range(2000)]
    assert {patch.values.tobytes() for patch in drawn} == cutouts
    assert {patch.image_mean for patch in drawn} == {float(IMAGE.mean())}


def test_the_symmetries_are_those_of_a_square():
    square = np.arange(4, dtype=np.float32).reshape(2, 2)
    results = [apply_symmetry(square, symmetry) for symmetry in range(8)]
    assert len({result.tobytes() for result in results}) == 8
    # The diagonals remain opposite corners.
    assert all({result[0, 0], result[1, 1]} in ({0, 3}, {1, 2}) for result in results)


def test_generated_images_are_new_in_every_patch():
    numbers = []

    def make(generator, number):
        numbers.append(number)
        return generator.random((number, 6, 8), np.float32)

    source = GeneratedPatches(make)
    first, second = source.draw(rng(1), 6), source.draw(rng(2), 6)
    assert (first.values != second.values).all()
    assert source.max_side == 6
    assert set(numbers) == {1}
    assert "make" in source.fingerprint()


def test_a_generated_image_smaller_than_the_patch_is_refused():
    sizes = iter([8, 8, 6])
    source = GeneratedPatches(lambda rng, number: np.ones((number, 9, next(sizes)), np.float32))
    assert source.draw(rng(), 8).values.shape == (8, 8)
    message = (
        "images: expected a callable of images of at least 8 x 8 pixels, .* got 9 x 6; .*patch="
    )
    with pytest.raises(ValueError, match=message):
        source.draw(rng(), 8)


@pytest.mark.slow
def test_a_mixture_draws_from_its_sources_by_weight():
    weights = {0.1: 1, 0.5: 2, 0.9: 5}
    mixture = PatchMixture(
        [
            (ImagePatches([np.full((6 + weight, 20), level)]), weight)
            for level, weight in weights.items()
        ]
    )
    assert mixture.max_side == 7
    generator = rng()
    means = np.array([mixture.draw(generator, 4).image_mean for _ in range(4000)])
    for level, weight in weights.items():
        low, high = binom.ppf([1e-6, 1 - 1e-6], 4000, weight / 8)
        assert low <= (abs(means - level) < 1e-6).sum() <= high


def test_fingerprints_identify_images_weights_and_settings():
    first, second = ImagePatches([IMAGE]), ImagePatches([IMAGE + 1])
    photograph = np.zeros((4, 4), np.uint8)
    sources = [
        first,
        second,
        SyntheticPatches(),
        PhotographPatches([photograph]),
        PhotographPatches([photograph], scaled=0.4),
        PhotographPatches([photograph + 1]),
        PatchMixture([(first, 1), (second, 1)]),
        PatchMixture([(first, 1), (second, 2)]),
        PatchMixture([(second, 1), (first, 1)]),
    ]
    assert len({source.fingerprint() for source in sources}) == len(sources)
    assert ImagePatches([IMAGE.copy()]).fingerprint() == first.fingerprint()


def test_images_and_functions_become_sources():
    assert isinstance(as_patch_source(IMAGE[None]), ImagePatches)
    assert isinstance(as_patch_source([IMAGE]), ImagePatches)
    assert isinstance(as_patch_source(lambda rng, n: rng.random((n, 4, 4))), GeneratedPatches)
    source = SyntheticPatches()
    assert as_patch_source(source) is source
    with pytest.raises(ValueError, match="images: expected at least one"):
        as_patch_source([])


def test_the_smallest_image_is_described():
    images = [IMAGE, IMAGE[:4]]
    photographs = PhotographPatches([np.zeros((9, 8), np.uint8), np.zeros((3, 9, 3), np.uint8)])
    mixture = PatchMixture([(ImagePatches(images), 1), (photographs, 1), (SyntheticPatches(), 1)])
    assert "number 1, is 4 x 9;" in ImagePatches(images).describe_limit()
    assert "number 1, is 3 x 9;" in mixture.describe_limit()
    assert "4096" in SyntheticPatches().describe_limit()


@pytest.mark.parametrize("weights", [[], [0.0], [1, -1.0], [float("nan")], [float("inf")]])
def test_weights_that_do_not_fit_are_refused(weights):
    with pytest.raises(ValueError, match="weights: expected"):
        PatchMixture([(ImagePatches([IMAGE]), weight) for weight in weights])


def test_images_in_place_of_a_source_are_refused():
    with pytest.raises(TypeError, match=r"such as ImagePatches\(images\).*got ndarray"):
        PatchMixture([(IMAGE, 1)])
