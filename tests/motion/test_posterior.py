"""Errors of displacements: closed forms, and how often the truth lies within them."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.posterior import posterior_error
from moving import aligned, constant_motion, in_memory


def test_the_error_is_the_root_of_half_the_trace_of_the_inverse():
    rng = np.random.default_rng(0)
    motion = constant_motion([(0, 0), (1, 2), (2, 1)], (40, 50), [0, 4, 8], 4)
    roots = rng.normal(size=(1, 3, 3, 4, 2, 2)) + 2 * np.eye(2)
    matrices = roots @ roots.swapaxes(-1, -2)
    information = np.stack(
        [matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]], axis=2
    ).astype(np.float32)
    found = posterior_error(dataclasses.replace(motion, information=information))
    for row, column in ((0, 0), (20, 31), (39, 49)):
        inverses = [np.linalg.inv(each[row // 16, column // 16]) for each in matrices[0]]
        expected = np.sqrt(np.mean([np.trace(inverse) / 2 for inverse in inverses]))
        assert found[row, column] == pytest.approx(expected, rel=1e-4)


def test_each_pixel_has_the_error_of_its_own_field():
    motion = constant_motion([(0, 0), (1, 2)], (20, 40), [0, 4], 0)
    labels = np.zeros((20, 40), np.uint8)
    labels[:, 25:] = 1
    information = np.concatenate([motion.information, 4 * motion.information])
    motion = dataclasses.replace(
        motion,
        nodes=motion.nodes.repeat(2, axis=0),
        information=information,
        labels=labels,
        model="segments",
    )
    error = posterior_error(motion)
    np.testing.assert_allclose(error, np.where(labels, 0.05, 0.1), rtol=1e-5)


def test_blocks_without_light_do_not_change_the_error():
    motion = constant_motion([(0, 0), (1, 2), (2, 1)], (40, 50), [0, 4, 8], 4)
    information = motion.information.copy()
    information[:, 1] = 0
    found = posterior_error(dataclasses.replace(motion, information=information))
    np.testing.assert_allclose(found, posterior_error(motion))


def test_without_information_the_error_is_large_and_finite():
    motion = constant_motion([(0, 0), (1, 2)], (20, 40), [0, 4], 0)
    for values in ((0, 0, 0), (1, 1, 1), (1, 2, 1), (5, 0, 0), (1e-30, 0, 1e-30)):
        information = np.zeros_like(motion.information) + np.float32(values)[:, None, None]
        error = posterior_error(dataclasses.replace(motion, information=information))
        np.testing.assert_allclose(error, 100)


def test_a_scene_that_stands_still_has_no_error():
    motion = constant_motion([(0, 0), (0, 0)], (20, 40), [0, 4], 0, model="none")
    assert (posterior_error(motion) == 0).all()


def standardized(scene, motion):
    """Return the errors of all nodes in units of their posterior standard deviations."""
    found = []
    for number, time in enumerate(motion.times):
        # All points of a scene that only shifts have the same displacement.
        truth = scene.motion(time, at=motion.reference)[:, 0, 0]
        errors = motion.nodes[0, number] - truth[:, None, None]
        rows, mixed, columns = motion.information[0, number].astype(float)
        variances = np.stack([columns, rows]) / (rows * columns - mixed**2)
        found.append(errors / np.sqrt(variances))
    return np.stack(found)


def check(errors):
    assert (abs(errors) < 3).mean() >= 0.99
    # The stated errors are also not much too large.
    assert np.sqrt((errors**2).mean()) > 0.3


@pytest.mark.slow
def test_the_true_displacement_lies_within_three_posterior_deviations():
    scenes = [aligned("shake"), aligned("shake", photons=0.1, rng=1)]
    check(np.concatenate([standardized(scene, motion).ravel() for scene, _, motion in scenes]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("photograph", "photons"),
    [
        ("camera", 0.05),
        ("coins", 0.2),
        ("astronaut", 0.7),
        *(
            pytest.param(*case, marks=pytest.mark.exhaustive)
            for case in (
                ("camera", 0.2),
                ("camera", 0.7),
                ("coins", 0.05),
                ("coins", 0.7),
                ("astronaut", 0.05),
                ("astronaut", 0.2),
            )
        ),
    ],
)
def test_the_posterior_holds_for_scenes_and_exposures(photograph, photons):
    errors = []
    for seed in range(3):
        scene = jl.datasets.moving(
            jl.datasets.photograph(photograph, gray=True),
            motion="shake",
            sensor=jl.Sensor(frames=64),
            shape=(96, 112),
            photons=photons,
            rng=seed,
        )
        motion = jl.align(in_memory(scene))
        assert len(motion.nodes) == 1
        errors.append(standardized(scene, motion).ravel())
    check(np.concatenate(errors))
