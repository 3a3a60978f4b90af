"""Synthetic patches."""

import numpy as np
import pytest

from jotlight.training import SyntheticPatches


@pytest.mark.parametrize("fine", [0.0, 0.5])
@pytest.mark.parametrize("side", [1, 7, 48])
def test_intensities_are_in_the_unit_interval(side, fine):
    generator = np.random.default_rng(0)
    for _ in range(60):
        patch = SyntheticPatches(fine=fine).draw(generator, side)
        assert patch.values.shape == (side, side)
        assert patch.values.dtype == np.float32
        assert 0 <= patch.values.min() <= patch.values.max() <= 1 + 1e-6


def test_a_seed_determines_a_patch():
    first, again, other = (
        SyntheticPatches().draw(np.random.default_rng(seed), 24).values for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_fine_drawings_have_high_frequencies():
    generator = np.random.default_rng(2)

    def share_of_high_frequencies(fine):
        """Return the mean share of the energy above a quarter of a cycle per pixel."""
        shares = []
        for _ in range(60):
            values = SyntheticPatches(fine=fine).draw(generator, 32).values
            energy = abs(np.fft.rfft2(values - values.mean())) ** 2
            frequency = np.hypot(np.fft.fftfreq(32)[:, None], np.fft.rfftfreq(32))
            shares.append(energy[frequency > 0.25].sum() / max(energy.sum(), 1e-9))
        return np.mean(shares)

    assert share_of_high_frequencies(1.0) > 2 * share_of_high_frequencies(0.0)


@pytest.mark.parametrize("fine", [-0.1, 1.1, np.nan])
def test_a_fraction_outside_the_unit_interval_is_refused(fine):
    with pytest.raises(ValueError, match="fine: expected"):
        SyntheticPatches(fine=fine)


@pytest.mark.slow
def test_patches_are_flat_saturated_dark_and_structured():
    generator = np.random.default_rng(1)
    patches = np.array([SyntheticPatches().draw(generator, 32).values for _ in range(400)])
    deviations = patches.std((1, 2))
    assert 0.03 < (deviations < 1e-6).mean() < 0.3
    assert (deviations > 0.2).mean() > 0.2
    assert (patches == 0).all((1, 2)).any()
    assert (patches > 1 - 1e-6).all((1, 2)).any()
    # Edges lie anywhere in a pixel, so patches have many intermediate levels.
    assert len(np.unique(patches.round(3))) > 500
