"""The state of the page's controls, from untrusted JSON."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jotlight.evaluation.methods import METHODS
from jotlight.view.messages import decode_request, encode
from jotlight.view.state import MAX_STATE_BYTES, OVERLAYS, ViewState, parse_probe

STATES = st.fixed_dictionaries(
    {},
    optional={
        "start": st.integers(0, 2**40),
        "window": st.integers(1, 2**40),
        "method": st.sampled_from(["counts", *METHODS]),
        "compare": st.none() | st.sampled_from(list(METHODS)),
        "align": st.booleans(),
        "curve": st.sampled_from(["linear", "gamma", "log", "reinhard"]),
        "white": st.none() | st.floats(1e-6, 1e6),
        "overlays": st.lists(st.sampled_from(OVERLAYS), max_size=3),
        "follow": st.booleans(),
    },
)


@given(STATES)
def test_a_state_survives_a_round_trip(values):
    state = ViewState.from_json(values)
    assert ViewState.from_json(json.loads(json.dumps(state.to_json()))) == state


@given(
    STATES,
    st.integers(0, 1000),
    st.integers(1, 300),
    st.integers(1, 7),
)
def test_a_window_is_whole_cycles_of_the_frames(values, first, number, cycle):
    frames = range(first, first + number * cycle)
    span = ViewState.from_json(values).within(frames, cycle).span
    assert frames.start <= span.start < span.stop <= frames.stop
    assert (span.start - first) % cycle == len(span) % cycle == 0


@pytest.mark.parametrize(
    "value",
    [
        *(None, [], "x", 3, {"unknown": 1}, {"start": -1}, {"start": 1.5}, {"start": True}),
        *({"window": 0}, {"window": 2**60}, {"window": "64"}, {"method": "rm -rf"}, {"method": 3}),
        *({"compare": "counts"}, {"align": 1}, {"curve": "../x"}, {"white": 0}, {"white": -1}),
        *({"white": float("nan")}, {"white": float("inf")}, {"white": "1"}, {"overlays": "jots"}),
        *({"overlays": ["x"]}, {"overlays": ["jots"] * 4}, {"method": ["mle"]}, {"start": 10**400}),
    ],
)
def test_other_values_are_refused(value):
    with pytest.raises(ValueError, match="expected"):
        ViewState.from_json(value)


def test_messages_of_errors_are_short():
    with pytest.raises(ValueError, match="expected") as caught:
        ViewState.from_json({"method": "x" * 10**6})
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null", '{"type": 3}', "{}", "[" * 10_000])
def test_messages_that_are_no_requests_are_refused(text):
    with pytest.raises(ValueError, match="message: expected"):
        decode_request(text)


def test_long_messages_are_refused():
    with pytest.raises(ValueError, match="at most"):
        decode_request(json.dumps({"type": "view", "x": "a" * MAX_STATE_BYTES}))


def test_a_probe_is_a_place_or_nothing():
    assert parse_probe({"row": 3, "column": 4}) == (3, 4)
    assert parse_probe({"row": None}) is None
    for message in ({"row": -1, "column": 0}, {"row": 1}, {"row": "1", "column": 1}):
        with pytest.raises(ValueError, match="expected"):
            parse_probe(message)


# Of the characters, those that JSON escapes, and those of one to four bytes.
TEXTS = st.text('a"\\\n\0é漢😀')


@given(st.dictionaries(TEXTS, TEXTS | st.integers()), st.binary())
def test_the_header_and_the_bytes_of_a_message_can_be_read(header, payload):
    message = encode(header, np.frombuffer(payload, np.uint8))
    size = int.from_bytes(message[:4], "little")
    assert size % 4 == 0
    assert json.loads(message[4 : 4 + size]) == header
    assert message[4 + size :] == payload
