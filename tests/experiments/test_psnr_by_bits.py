"""Curves of the PSNR by K."""

from jotlight.experiments import psnr_by_bits
from jotlight.experiments.experiment import Results


def test_the_curves_of_the_initial_networks_differ_in_gray(monkeypatch):
    drawn = []
    monkeypatch.setattr(psnr_by_bits, "render_svg", lambda axes: drawn.extend(axes) or "")
    sigmas = psnr_by_bits.SETTINGS["sigmas"]
    rows = [
        {"bits": 9, "estimator": estimator, "sigma": sigma, "psnr": 10.0}
        for estimator, values in (("initial", sigmas), ("learned", [None]))
        for sigma in values
    ]
    psnr_by_bits.psnr_curves(Results({"bits": [9], "sigmas": sigmas}, rows), "name", "title")
    lines = [line for line in drawn[0].lines if line.label.startswith("initial")]
    assert len({line.marker for line in lines}) == len(sigmas) == 5
    assert len({(line.marker, line.style) for line in drawn[0].lines}) == len(drawn[0].lines)
