"""The PSNR that no estimator exceeds on synthetic scenes."""

import mpmath
import pytest

from jotlight.experiments.posterior_mean import posterior_mean_psnr


@pytest.mark.slow
@pytest.mark.parametrize("bits", [1, 2, 9])
def test_the_limit_agrees_with_its_definition(bits):
    """The definition is E[c²] - Σ P(L) E[c | L]², here by mpmath's quadrature."""
    with mpmath.workdps(30):
        kept = mpmath.mpf(0)
        for ones in range(bits + 1):

            def joint(c, power, ones=ones):
                p = 1 - mpmath.exp(-c)
                return c**power * mpmath.binomial(bits, ones) * p**ones * (1 - p) ** (bits - ones)

            evidence, first = (
                mpmath.quad(lambda c, power=power: joint(c, power), [0, 0.5, 1]) for power in (0, 1)
            )
            kept += first**2 / evidence
        expected = -10 * mpmath.log10(mpmath.mpf(1) / 3 - kept)
    assert posterior_mean_psnr(bits) == pytest.approx(float(expected), abs=1e-9)


@pytest.mark.parametrize(
    ("bits", "expected"),
    list(
        zip(
            (9, 16, 25, 36, 49, 64, 81, 100),
            (14.816, 16.394, 17.769, 18.972, 20.037, 20.990, 21.851, 22.636),
            strict=True,
        )
    ),
)
@pytest.mark.slow
def test_the_limit_has_the_known_value_for_each_k_of_the_paper(bits, expected):
    assert posterior_mean_psnr(bits) == pytest.approx(expected, abs=6e-4)


@pytest.mark.slow
def test_twice_the_nodes_change_nothing():
    for bits in (1, 300):
        twice = posterior_mean_psnr(bits, nodes=800)
        assert posterior_mean_psnr(bits) == pytest.approx(twice, abs=1e-9)


@pytest.mark.parametrize("bits", [0, 1001])
def test_a_number_of_bits_out_of_range_is_rejected(bits):
    with pytest.raises(ValueError, match="expected 1 to 1000"):
        posterior_mean_psnr(bits)
