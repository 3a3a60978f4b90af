import numpy as np
import pytest

from jotlight.motion.motion import Motion


def random_motion():
    rng = np.random.default_rng(0)
    nodes = rng.normal(size=(4, 2, 3, 5)).astype(np.float32)
    information = rng.random((4, 3, 3, 5), np.float32)
    return Motion(nodes, np.array([1.5, 4, 8, 20]), (40, 70), 5.0, "tiles", information)


def test_displacements_are_linear_in_time():
    motion = random_motion()
    np.testing.assert_allclose(motion.at(4), motion.at(4.0))
    middle = (motion.at(8) + motion.at(20)) / 2
    np.testing.assert_allclose(motion.at(14), middle, atol=1e-5)
    beyond = motion.at(20) + (motion.at(20) - motion.at(8))
    np.testing.assert_allclose(motion.at(32), beyond, atol=1e-4)
    assert motion.at(3).shape == (2, 40, 70)


def test_the_representation_states_the_length_of_the_motion():
    assert repr(random_motion()).startswith("<Motion: tiles, 40 x 70 jots, 4 times from 1.5 to 20")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"nodes": np.zeros((4, 2, 3, 4), np.float32)}, "nodes: expected shape"),
        ({"information": np.zeros((4, 2, 3, 5), np.float32)}, "information: expected shape"),
        ({"times": np.array([1.0, 1, 2, 3])}, "times: expected finite numbers that increase"),
        ({"nodes": np.full((4, 2, 3, 5), np.nan, np.float32)}, "expected finite numbers"),
        ({"model": "flow"}, "model: expected one of none, affine, tiles"),
    ],
)
def test_parts_that_do_not_fit_are_refused(changes, message):
    motion = random_motion()
    parts = {name: getattr(motion, name) for name in motion.__dataclass_fields__}
    with pytest.raises(ValueError, match=message):
        Motion(**{**parts, **changes})
