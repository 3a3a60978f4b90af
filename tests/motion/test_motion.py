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


def test_a_saved_motion_has_the_same_arrays(tmp_path):
    motion = random_motion()
    motion.save(tmp_path / "motion.npz")
    with np.load(tmp_path / "motion.npz") as arrays:
        np.testing.assert_array_equal(arrays["nodes"], motion.nodes)
        np.testing.assert_array_equal(arrays["times"], motion.times)


def test_no_motion_is_zero():
    motion = Motion.none((40, 70), 100, 50)
    assert not motion.at(33).any()
    assert repr(motion).startswith("<Motion: none, 40 x 70 jots, 2 times from 0 to 99")


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
