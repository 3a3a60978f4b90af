"""The name of the method that a caller requests."""

import pytest

from jotlight.evaluation.methods import METHODS, OPTION_DEFAULTS
from jotlight.evaluation.requested_method import requested_method


def test_without_a_name_or_an_option_nothing_is_requested():
    assert requested_method(None) is None


@pytest.mark.parametrize(("option", "method"), OPTION_DEFAULTS.items())
def test_an_option_selects_a_method_that_takes_it(option, method):
    assert requested_method(None, [option]) == method
    assert option in METHODS[method].options


@pytest.mark.parametrize(
    ("method", "option"),
    [("noniterative-gaussian", "inverse"), ("mle-iterative", "tol")],
)
def test_a_name_is_kept_beside_its_options(method, option):
    assert requested_method(method, [option]) == method


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("magic", [], "method: there is no 'magic'; expected one of mle, "),
        ("mle-iterative", ["norm"], "norm: is an option of admm-tv, not of mle-iterative"),
        ("network-colr", [], "did you mean network-color?"),
        ("network-color", ["weight"], "weight: is an option of admm-tv, not of network-color"),
        ("admm-tv", ["inverse"], "inverse: is an option of noniterative-gaussian, .* not of admm"),
        (None, ["inverse", "tol"], "tol: is an option of mle-iterative, admm-tv, not of noniter"),
    ],
)
def test_a_request_that_cannot_be_met_is_refused(method, options, message):
    with pytest.raises(ValueError, match=message):
        requested_method(method, options)


def test_every_option_of_a_method_selects_one():
    assert set(OPTION_DEFAULTS) == set().union(*(method.options for method in METHODS.values()))
