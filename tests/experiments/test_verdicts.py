"""The verdicts on the paper's claims follow from the numbers, on both sides of each threshold."""

import pytest

from jotlight.experiments import fig5, fig6a, fig6b, fig7, gain, psnr_by_bits, timing
from jotlight.experiments.experiment import Results
from jotlight.experiments.method_titles import ALGEBRAIC, UNTIED

SIGMAS = [0.25, 0.7]


def claims_of(section, words):
    (claim,) = (claim for claim in section.claims if words in claim.statement)
    return claim


def by_bits_results(gains_at_9, gains_at_100, learned=(15.0, 20.0), data=None):
    """Return results with these gains over each σ."""
    rows = []
    for bits, end, gains in ((9, learned[0], gains_at_9), (100, learned[1], gains_at_100)):
        rows.append({"bits": bits, "estimator": "mle", "sigma": None, "psnr": 10.0})
        for sigma, value in zip(SIGMAS, gains, strict=True):
            start = {"bits": bits, "estimator": "initial", "sigma": sigma, "psnr": end - value}
            rows.append(start)
        rows.append({"bits": bits, "estimator": "learned", "sigma": None, "psnr": end})
        rows.append({"bits": bits, "estimator": "limit", "sigma": None, "psnr": end + 0.01})
    rows.append({"bits": 9, "estimator": "descent", "sigma": 0.25, "psnr": learned[0] - 0.2})
    settings = {
        "quick": True,
        "bits": [9, 100],
        "sigmas": SIGMAS,
        "descents": [9],
        "sigma": 0.25,
        "steps": 10,
        "learning_steps": None,
        "test_scenes": 8,
        "test_images": 8,
        "data": {"cifar10": "few"},
    }
    return Results(settings, rows, others={} if data is None else data)


@pytest.mark.parametrize(
    ("at_9", "at_100", "verdict"),
    [
        ((1.7, 1.3), (0.5, 0.6), "reproduced"),
        ((1.7, 1.7), (0.5, 3.0), "in part"),
        ((1.7, 1.1), (0.5, 0.6), "in part"),
        ((1.1, 2.3), (0.5, 0.6), "not reproduced"),
        ((1.7, 1.7), (1.8, 1.8), "not reproduced"),
    ],
)
@pytest.mark.slow
def test_the_largest_gain_has_to_be_the_papers_and_at_its_k(at_9, at_100, verdict):
    section = fig6a.section(by_bits_results(at_9, at_100))
    claim = claims_of(section, "largest gain is 1.7 dB")
    assert claim.verdict == verdict
    assert f"{at_9[0]:.2f} dB over σ = 0.25" in claim.result
    assert f"from σ = 0.25: {at_9[0] - 0.2:.2f} dB" in claim.result
    assert bool(claim.reason) == (verdict != "reproduced")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at_9", "at_100", "verdict"),
    [
        ((1.0, 0.1), (0.5, 0.6), "reproduced"),
        ((1.0, 0.1), (0.5, -0.1), "in part"),
        ((-1.0, 0.1), (0.5, -0.1), "not reproduced"),
    ],
)
def test_learning_has_to_gain_for_every_k(at_9, at_100, verdict):
    results = by_bits_results(at_9, at_100)
    for section in (fig6a.section(results), fig6b.section(results)):
        assert claims_of(section, "increases by learning for all K").verdict == verdict


@pytest.mark.parametrize(
    ("learned", "verdict"), [((15.0, 15.1), "reproduced"), ((15.0, 14.9), "not reproduced")]
)
def test_the_psnr_has_to_rise_with_k(learned, verdict):
    section = fig6a.section(by_bits_results((1, 1), (1, 1), learned))
    assert claims_of(section, "improves naturally").verdict == verdict


@pytest.mark.slow
@pytest.mark.parametrize(
    ("photographs", "synthetic", "verdict"),
    [
        ((3, 3), (2, 2), "reproduced"),
        ((3, 1), (2, 2), "in part"),
        ((1, 1), (2, 2), "not reproduced"),
    ],
)
def test_the_gain_has_to_exceed_that_on_synthetic_scenes(photographs, synthetic, verdict):
    others = {"fig6a": by_bits_results(synthetic, (0, 0))}
    section = fig6b.section(by_bits_results(photographs, (0, 0), data=others))
    assert claims_of(section, "more prominent").verdict == verdict
    section = fig6b.section(by_bits_results(photographs, (0, 0)))
    assert claims_of(section, "more prominent").verdict == "not tested"


def test_the_page_states_the_distance_from_the_limit():
    assert "at most 0.010 dB below" in fig6a.section(by_bits_results((1, 1), (1, 1))).text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("norms", "verdict"),
    [
        ({0.25: [9, 5, 1], 0.7: [90, 50, 10]}, "reproduced"),
        ({0.25: [9, 10, 1], 0.7: [90, 50, 51]}, "in part"),
        ({0.25: [9, 10, 1], 0.7: [90, 50, 53]}, "not reproduced"),
    ],
)
def test_cost_and_gradient_have_to_fall_with_minor_rises_only(norms, verdict):
    rows = [
        {"sigma": sigma, "iteration": 4 * w + i, "cost": 9.0 - w, "gradient_norm": float(value)}
        for sigma, values in norms.items()
        for w, value in enumerate(values)
        for i in range(4)
    ]
    settings = {
        "quick": True,
        "sigmas": SIGMAS,
        "steps": 12,
        "window": 4,
        "learning_rate": 1,
        "batch": 1,
        "bits": 36,
    }
    section = fig5.section(Results(settings, rows))
    assert section.claims[0].verdict == verdict
    assert "9.00 to 7.00" in section.claims[0].result


def fig7_results(**psnr):
    rows = [
        {"image": image, "method": method, "psnr": value, "snr": value, "ssim": value / 50}
        for method, value in psnr.items()
        for image in ("a", "b")
    ]
    return Results({"quick": True, "bits": 16, "data": {"bsds300": "few"}}, rows)


@pytest.mark.parametrize(
    ("network", "verdict", "structure"),
    [
        (25.0, "reproduced", "not reproduced"),
        (24.4, "not reproduced", "not reproduced"),
        (25.3, "reproduced", "reproduced"),
        (25.6, "better", "reproduced"),
    ],
)
def test_the_network_has_to_be_close_to_bm3d(network, verdict, structure):
    measured = {
        "mle": 15.0,
        "noniterative-bm3d": 25.2,
        ALGEBRAIC: 25.05,
        "network-two-layer": network,
    }
    claims = fig7.section(fig7_results(**measured)).claims
    assert [claim.verdict for claim in claims] == [verdict, structure]
    assert all(bool(claim.reason) == (claim.verdict == "not reproduced") for claim in claims)


def test_claims_about_bm3d_are_not_tested_without_it():
    claims = fig7.section(fig7_results(**{"mle": 15.0, "network-two-layer": 24.0})).claims
    assert {claim.verdict for claim in claims} == {"not tested"}


def timing_results(**milliseconds):
    rows = [
        {
            "cores": cores,
            "method": method,
            "round": number,
            "height": 3,
            "width": 4,
            "milliseconds": value * (1 if cores == "one core" else 0.5) + 0.01 * number,
        }
        for cores in ("one core", "all cores")
        for method, value in milliseconds.items()
        for number in (-1, 0, 1)
    ]
    return Results({"quick": True, "bits": 16, "rounds": 3}, rows)


@pytest.mark.parametrize(
    ("bm3d", "untied", "beside_bm3d", "beside_mle"),
    [
        (600.0, 100.0, "better", "reproduced"),
        (500.0, 100.0, "not reproduced", "reproduced"),
        (600.0, 60.0, "better", "better"),
        (900.0, 120.0, "better", "not reproduced"),
    ],
)
def test_the_ratios_of_times_have_to_be_the_papers(bm3d, untied, beside_bm3d, beside_mle):
    measured = {"mle": 10.0, "noniterative-bm3d": bm3d, "network-two-layer": 50.0, UNTIED: untied}
    section = timing.section(timing_results(**measured))
    assert claims_of(section, "5.25 times").verdict == beside_bm3d
    assert claims_of(section, "8.7 times").verdict == beside_mle
    assert f"{bm3d / untied:.0f} times as fast" in claims_of(section, "5.25 times").result
    (row,) = (row for row in section.tables[0].rows if row[0] == "maximum likelihood")
    assert row[1:] == pytest.approx([10.0, 0.2, 5.0, 0.2])


def test_the_ratio_to_bm3d_is_not_tested_without_it():
    section = timing.section(
        timing_results(**{"mle": 1.0, "network-two-layer": 5.0}, **{UNTIED: 9.0})
    )
    assert claims_of(section, "5.25 times").verdict == "not tested"


def test_the_best_methods_follow_from_the_numbers():
    psnr = {"mle": 20.0, "noniterative-bm3d": 30.0, "admm-tv": 29.0, "network-two-layer": 28.0}
    rows = [
        {"axis": axis, "bits": 16, "gain": 16, "image": "a", "method": name, "psnr": value}
        for axis in ("exposure", "bits")
        for name, value in psnr.items()
    ]
    settings = {"quick": True, "bits": 16, "gains": [16], "many_bits": [16], "side": 8}
    speeds = timing_results(**{"mle": 1.0, "network-two-layer": 5.0, "admm-tv": 400.0, UNTIED: 9.0})
    section = gain.section(Results(settings, rows, others={"timing": speeds}))
    winners = section.tables[1].rows[0]
    names = ["non-iterative, BM3D", "ADMM, total variation", "network, two-layer"]
    assert list(winners[1::2]) == names
    assert list(winners[2::2]) == [30.0, 29.0, 28.0]


def test_a_claim_holds_in_part_if_it_holds_for_some_starts():
    assert psnr_by_bits.verdict_of([1.0], [1.0]) == ("reproduced", "")
    assert psnr_by_bits.verdict_of([], [1.0, 2.0])[0] == "not reproduced"
    verdict, why = psnr_by_bits.verdict_of([2.0], [1.0, 2.0])
    assert verdict == "in part"
    assert "σ = 2.0" in why
